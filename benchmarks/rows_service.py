"""Rows of the table of truth: service."""

from __future__ import annotations
