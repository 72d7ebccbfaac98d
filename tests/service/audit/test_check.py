"""The audit log's chain: what was changed, taken out or put in shows."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from audit_parts import FOUR_FILES, audit, check, event, written

from modalmotion_service.audit.entry import (
    GENESIS,
    Place,
    chained,
)
from modalmotion_service.audit.log import audit_folder


def test_a_file_taken_out_or_made_anew_shows(tmp_path: Path) -> None:
    here = audit_folder(tmp_path)
    written(tmp_path, 10, entries_per_file=3)
    written(tmp_path / "other", 10, entries_per_file=3)
    shutil.copy(audit_folder(tmp_path / "other") / FOUR_FILES[2], here)
    (fault, after) = check(tmp_path).faults
    assert fault.startswith("000000000007.sqlite follows entry 6, and not entry 6 as it is")
    assert after.startswith("000000000010.sqlite follows entry 9")
    (here / FOUR_FILES[2]).unlink()
    assert check(tmp_path).faults == (
        "000000000010.sqlite follows entry 9, and not entry 6 as it is here",
    )


Tampering = Callable[[sqlite3.Connection], object]

TAMPERING: dict[str, tuple[Tampering, str]] = {
    "another id": (
        lambda file: file.execute("UPDATE audit SET ids = 'x' WHERE number = 4"),
        "entry 4 is not what was written",
    ),
    "another time": (
        lambda file: file.execute("UPDATE audit SET time = '2000' WHERE number = 1"),
        "entry 1 is not what was written",
    ),
    "one taken out": (
        lambda file: file.execute("DELETE FROM audit WHERE number = 4"),
        "entries 4 to 4 are missing",
    ),
    "the first taken out": (
        lambda file: file.execute("DELETE FROM audit WHERE number = 1"),
        "entries 1 to 1 are missing",
    ),
    "two exchanged": (
        lambda file: file.executescript(
            "UPDATE audit SET number = 99 WHERE number = 4;"
            "UPDATE audit SET number = 4 WHERE number = 5;"
            "UPDATE audit SET number = 5 WHERE number = 99;"
        ),
        "entry 4 is not what was written",
    ),
    "one taken out and the others renumbered": (
        lambda file: file.executescript(
            "DELETE FROM audit WHERE number = 4;"
            "UPDATE audit SET number = number - 1 WHERE number > 4;"
        ),
        "entry 4 is not what was written",
    ),
}


@pytest.mark.parametrize("kind", TAMPERING)
def test_tampering_shows(tmp_path: Path, kind: str) -> None:
    change, says = TAMPERING[kind]
    written(tmp_path, 8)
    assert audit("verify", "--data-dir", str(tmp_path)).exit_code == 0
    path = tmp_path / "access" / "audit" / "000000000001.sqlite"
    file = sqlite3.connect(path)
    with pytest.raises(sqlite3.IntegrityError, match="not changed"):
        file.execute("UPDATE audit SET ids = 'x' WHERE number = 4")
    file.executescript("DROP TRIGGER audit_is_not_changed; DROP TRIGGER audit_is_not_shortened;")
    change(file)
    file.commit()
    file.close()
    found = audit("verify", "--data-dir", str(tmp_path))
    assert found.exit_code == 1
    assert says in found.output


def test_a_log_cut_short_or_made_anew_shows_by_what_was_noted(tmp_path: Path) -> None:
    noted = written(tmp_path / "a", 5).end
    assert (noted.number, check(tmp_path / "a", noted).faults) == (5, ())
    written(tmp_path / "a", 1)
    written(tmp_path / "b", 4)
    here = ("--noted", str(noted), "--data-dir")
    assert audit("verify", *here, str(tmp_path / "a")).exit_code == 0
    cut = audit("verify", *here, str(tmp_path / "b"))
    assert (cut.exit_code, "entry 5 with the digest" in cut.output) == (1, True)
    assert audit("verify", "--noted", "5", "--data-dir", str(tmp_path / "a")).exit_code == 2
    assert audit("verify", "--data-dir", str(tmp_path / "nothing")).exit_code == 1


def test_an_entry_depends_on_everything_in_it_and_before_it() -> None:
    first = chained(GENESIS, "t", event())
    others = [
        chained(Place(0, "1" * 64), "t", event()),
        chained(Place(1, GENESIS.sha256), "t", event()),
        chained(GENESIS, "u", event()),
        chained(GENESIS, "t", event(1)),
    ]
    assert len({first.sha256, *(other.sha256 for other in others)}) == 5
