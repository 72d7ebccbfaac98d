"""Rows of the table of truth: classes."""

from __future__ import annotations
