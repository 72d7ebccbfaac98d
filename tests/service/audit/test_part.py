"""The audit log's files: one after another, whole, archived."""

from __future__ import annotations

import json
import shutil
import sqlite3
import stat
import threading
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from access_parts import guarded
from audit_parts import FOUR_FILES, audit, check, event, names, tamper, written

from modalmotion.errors import CorruptFileError, ParameterError, StoreError
from modalmotion_service.audit.archive import archive_audit
from modalmotion_service.audit.check import check_audit, unfinished
from modalmotion_service.audit.entry import (
    BEGUN,
    GENESIS,
    AuditEntry,
)
from modalmotion_service.audit.log import AuditLog, audit_folder, parts_in
from modalmotion_service.audit.part import AuditWriter


def test_a_full_file_is_closed_and_the_chain_goes_on_in_the_next(tmp_path: Path) -> None:
    report = written(tmp_path, 10, entries_per_file=3)
    assert (report.n_entries, report.start, report.faults) == (10, GENESIS, ())
    folder = audit_folder(tmp_path)
    assert names(folder) == FOUR_FILES
    # Without a second file beside them: they can be copied as they are.
    beside = {path.name.partition("-")[0] for path in folder.glob("*-wal")}
    assert beside <= set(FOUR_FILES[3:])
    assert [part.is_closed() for part in parts_in(folder)] == [True, True, True, False]
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o600}
    file = sqlite3.connect(folder / FOUR_FILES[0])
    with pytest.raises(sqlite3.IntegrityError, match="closed"):
        file.execute(
            "INSERT INTO audit SELECT 4, time, '', '', '', '', '', '', '', 1, '' FROM audit"
        )
    file.close()
    whole = written(tmp_path / "one", 10)
    assert whole.n_entries == 10
    assert names(audit_folder(tmp_path / "one")) == FOUR_FILES[:1]


def test_pages_go_over_files(tmp_path: Path) -> None:
    written(tmp_path, 10, entries_per_file=3)
    with AuditLog(tmp_path) as log:
        seen: list[int] = []
        before = None
        while page := log.page(limit=4, before=before, owner="lab"):
            seen += [entry.number for entry in page]
            before = page[-1].number
        assert seen == list(range(10, 0, -1))
        assert log.page(limit=4, owner="nobody") == []
    lines = audit("show", "--limit", "5", "--data-dir", str(tmp_path)).output.splitlines()
    assert [json.loads(line)["number"] for line in lines] == [10, 9, 8, 7, 6]


def test_a_service_goes_on_while_its_log_is_archived(tmp_path: Path) -> None:
    with guarded(tmp_path, audit_entries_per_file=3) as service:
        for _ in range(10):
            assert service.ask("lab", "GET", "/v1/limits").status_code == 200
        archived = audit("archive", str(tmp_path / "kept"), "--data-dir", str(tmp_path))
        assert archived.stdout.startswith("3 files with the entries up to 9\n")
        service.ask("lab", "GET", "/v1/limits")
        entries = service.ask("chief", "GET", "/v1/audit").json()["entries"]
    assert [(one["number"], one["route"]) for one in entries] == [
        (12, "/v1/limits"),
        (11, "audit archive"),
        (10, "/v1/limits"),
    ]
    kept = parts_in(tmp_path / "kept")
    assert check_audit([*kept, *parts_in(audit_folder(tmp_path))]).faults == ()


def test_two_processes_write_one_chain_over_files(tmp_path: Path) -> None:
    """As the server and a command: whoever closes a file, the other goes on in the next."""

    def write(log: AuditLog) -> None:
        for number in range(40):
            log.append([event(number)])

    with AuditLog(tmp_path, 7) as one, AuditLog(tmp_path, 5) as other:
        threads = [threading.Thread(target=write, args=(log,)) for log in (one, other)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    report = check(tmp_path)
    assert (report.n_entries, report.faults) == (80, ())
    assert len(parts_in(audit_folder(tmp_path))) >= 80 // 7


@pytest.mark.parametrize("when", ["closed", "made", "empty"])
def test_a_crash_between_two_files_loses_nothing(tmp_path: Path, when: str) -> None:
    end = written(tmp_path, 3).end
    folder = audit_folder(tmp_path)
    writer = AuditWriter(folder / FOUR_FILES[0], GENESIS)
    writer.close_for_good()
    writer.close()
    if when == "made":
        (folder / FOUR_FILES[1]).touch(0o600)
    if when == "empty":
        AuditWriter(folder / FOUR_FILES[1], end).close()
    report = written(tmp_path, 1)
    assert (report.n_entries, report.faults) == (4, ())
    assert names(folder) == FOUR_FILES[:2]


def test_a_next_file_that_cannot_be_made_takes_no_entry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with AuditLog(tmp_path, 2) as log:
        log.append([event(0), event(1)])
        with monkeypatch.context() as patch:
            patch.setattr("modalmotion_service.access.database.os.open", failing)
            with pytest.raises(StoreError):
                log.append([event(2)])
            with pytest.raises(StoreError):
                log.append([event(2)])
        log.append([event(3)])
        assert [entry.event.request_id for entry in log.page(limit=9)] == ["r3", "r1", "r0"]
    assert check(tmp_path).faults == ()


def test_closed_files_are_archived_and_stay_in_the_chain(tmp_path: Path) -> None:
    here, there, data_dir = audit_folder(tmp_path), tmp_path / "kept", str(tmp_path)
    written(tmp_path, 10, entries_per_file=3)
    run = audit("archive", str(there), "--data-dir", data_dir)
    assert (run.exit_code, names(here), names(there)) == (0, FOUR_FILES[3:], FOUR_FILES[:3])
    noted = run.stdout.splitlines()[-1]
    assert noted.startswith("9:")
    assert {stat.S_IMODE(path.stat().st_mode) for path in there.iterdir()} == {0o400}

    alone = audit("verify", "--data-dir", data_dir)
    assert (alone.exit_code, "entries 1 to 9 are not here" in alone.output) == (1, True)
    by_note = audit("verify", "--noted", noted, "--data-dir", data_dir)
    assert (by_note.exit_code, "2 entries after 9: whole" in by_note.output) == (0, True)
    # Archiving is noted too.
    both = audit("verify", "--archive", str(there), "--data-dir", data_dir)
    assert (both.exit_code, "11 entries: whole" in both.output) == (0, True)
    last = both.output.splitlines()[-1]
    assert audit("verify", "--noted", last, "--data-dir", data_dir).exit_code == 0
    wrong = f"9:{'0' * 64}"
    assert audit("verify", "--noted", wrong, "--data-dir", data_dir).exit_code == 1
    early = f"3:{check_audit(parts_in(there)[:1]).end.sha256}"
    assert audit("verify", "--noted", early, "--data-dir", data_dir).exit_code == 1

    (there / FOUR_FILES[1]).unlink()
    gap = audit("verify", "--archive", str(there), "--data-dir", data_dir)
    assert (gap.exit_code, "000000000007.sqlite follows entry 6" in gap.output) == (1, True)
    assert "Nothing to archive" in audit("archive", str(there), "--data-dir", data_dir).stdout


def test_archiving_goes_on_where_it_was_interrupted(tmp_path: Path) -> None:
    here, there = audit_folder(tmp_path), tmp_path / "kept"
    written(tmp_path, 10, entries_per_file=3)
    there.mkdir()
    shutil.copy(here / FOUR_FILES[0], there)
    both = audit("verify", "--archive", str(there), "--data-dir", str(tmp_path))
    assert (both.exit_code, "10 entries: whole" in both.output) == (0, True)
    assert [place.number for place in archive_audit(tmp_path, there)] == [3, 6, 9]
    assert (names(here), names(there)) == (FOUR_FILES[3:], FOUR_FILES[:3])


def test_what_was_read_while_it_was_closed_is_archived_whole(tmp_path: Path) -> None:
    here, there = audit_folder(tmp_path), tmp_path / "kept"
    with AuditLog(tmp_path, 2) as log:
        log.append([event(0), event(1)])
        uri = f"{(here / FOUR_FILES[0]).as_uri()}?mode=ro"
        reader = sqlite3.connect(uri, uri=True, isolation_level=None)
        reader.execute("BEGIN")
        reader.execute("SELECT * FROM audit").fetchone()
        log.append([event(2)])
    reader.close()
    assert (here / f"{FOUR_FILES[0]}-wal").stat().st_size
    assert [place.number for place in archive_audit(tmp_path, there)] == [2]
    both = [*parts_in(there), *parts_in(here)]
    assert (check_audit(both).n_entries, check_audit(both).faults) == (3, ())
    assert not [path for path in here.iterdir() if path.name.startswith(FOUR_FILES[0])]


def test_only_what_is_whole_and_old_enough_is_archived(tmp_path: Path) -> None:
    here, there = audit_folder(tmp_path), tmp_path / "kept"
    written(tmp_path, 10, entries_per_file=3)
    yesterday = datetime.now(UTC) - timedelta(days=1)
    assert archive_audit(tmp_path, there, older_than=yesterday) == []
    assert audit("archive", str(there), "--older-than", "1d", "--data-dir", str(tmp_path)).stdout
    assert names(here) == FOUR_FILES
    with pytest.raises(ParameterError, match="another folder"):
        archive_audit(tmp_path, here)
    tamper(here / FOUR_FILES[1], "UPDATE audit SET ids = 'x' WHERE number = 5")
    with pytest.raises(CorruptFileError, match="entry 5 is not what was written"):
        archive_audit(tmp_path, there)
    assert (names(here), names(there)) == (FOUR_FILES[1:], FOUR_FILES[:1])
    written(tmp_path / "other", 4, entries_per_file=3)
    with pytest.raises(ParameterError, match="has another"):
        archive_audit(tmp_path / "other", there)
    assert names(audit_folder(tmp_path / "other")) == FOUR_FILES[:2]


def test_changes_without_an_end_are_found(tmp_path: Path) -> None:
    events = [
        event(1, BEGUN),
        event(2, BEGUN),
        event(2),
        event(3),
        event(4, BEGUN),
        event(4, BEGUN),
    ]
    with AuditLog(tmp_path, 4) as log:
        for one in [*events, event(4, 201), event(5, 500)]:
            log.append([one])
    entries: list[AuditEntry] = []
    for part in parts_in(audit_folder(tmp_path)):
        entries += part.entries()
    assert [entry.number for entry in unfinished(entries)] == [1, 6]
    lines = audit("unfinished", "--data-dir", str(tmp_path)).output.splitlines()
    assert [json.loads(line)["number"] for line in lines] == [1, 6]
