"""Rows of the table of truth: readouts."""

from __future__ import annotations
