"""Rows of the table of truth: modes."""

from __future__ import annotations
