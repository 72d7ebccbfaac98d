"""Rows of the table of truth: tracking."""

from __future__ import annotations
