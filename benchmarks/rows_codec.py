"""Rows of the table of truth: codec."""

from __future__ import annotations
