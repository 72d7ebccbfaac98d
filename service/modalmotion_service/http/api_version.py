"""Version of the HTTP interface, apart from the package's."""

from __future__ import annotations

from typing import Final

API_VERSION: Final = "1.0.0"
"""Raised with every change of openapi/openapi.json: the first number where clients break, the
second where something is added, the third for words alone."""
