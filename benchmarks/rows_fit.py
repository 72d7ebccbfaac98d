"""Rows of the table of truth: fit."""

from __future__ import annotations
