"""Rows of the table of truth: use."""

from __future__ import annotations
