"""Rows of the table of truth: images."""

from __future__ import annotations
