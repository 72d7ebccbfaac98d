"""Audit logs of some files, written and checked."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from click.testing import CliRunner, Result

from modalmotion.cli import main
from modalmotion_service.audit.check import AuditReport, check_audit
from modalmotion_service.audit.entry import (
    Event,
    Place,
)
from modalmotion_service.audit.log import AuditLog, audit_folder, parts_in


def event(number: int = 0, status: int = 200) -> Event:
    return Event(f"r{number}", "lab", "0" * 16, "127.0.0.1", "GET", "/v1/sequences", "", status)


def audit(*words: str) -> Result:
    return CliRunner().invoke(main, ["audit", *words])


def check(data_dir: Path, noted: Place | None = None) -> AuditReport:
    return check_audit(parts_in(audit_folder(data_dir)), noted)


def written(data_dir: Path, n_entries: int, entries_per_file: int = 10**6) -> AuditReport:
    """Append entries one by one, numbered from 0."""
    with AuditLog(data_dir, entries_per_file) as log:
        for number in range(n_entries):
            log.append([event(number)])
    return check(data_dir)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*.sqlite"))


FOUR_FILES = [f"{number:012}.sqlite" for number in (1, 4, 7, 10)]


def tamper(path: Path, script: str) -> None:
    file = sqlite3.connect(path)
    file.executescript("DROP TRIGGER audit_is_not_changed; DROP TRIGGER audit_is_not_shortened;")
    file.executescript(script)
    file.commit()
    file.close()
