"""Rows of the table of truth: mission."""

from __future__ import annotations
