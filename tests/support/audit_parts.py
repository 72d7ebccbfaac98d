"""Audit logs, written and tampered with."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from click.testing import CliRunner, Result

from modalmotion.cli import main
from modalmotion_service.audit.entry import Event, Lines
from modalmotion_service.audit.log import AuditLog, audit_path


def event(number: int = 0, status: int = 200) -> Event:
    return Event(f"r{number}", "lab", "0" * 16, "127.0.0.1", "GET", "/v1/sequences", "", status)


def audit(*words: str) -> Result:
    return CliRunner().invoke(main, ["audit", *words])


def written(data_dir: Path, n_entries: int, lines: Path | None = None) -> None:
    """Append entries one by one, numbered from 0."""
    with AuditLog(data_dir, None if lines is None else Lines(str(lines))) as log:
        for number in range(n_entries):
            log.append([event(number)])


def tamper(data_dir: Path, script: str) -> None:
    file = sqlite3.connect(audit_path(data_dir))
    file.executescript(script)
    file.commit()
    file.close()
