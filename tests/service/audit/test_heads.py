"""What was in the audit log once shows that it is gone, whoever writes its files anew."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from access_parts import guarded
from audit_parts import audit, event, tamper, written

from modalmotion.store import backup
from modalmotion_service.audit.entry import GENESIS, Event, Place
from modalmotion_service.audit.heads import heads_of, note_head, places_in
from modalmotion_service.audit.log import AuditLog, audit_folder, parts_in
from modalmotion_service.audit.part import AuditWriter

N = 8


def database(folder: Path) -> Path:
    return audit_folder(folder) / "000000000001.sqlite"


def cut_the_end(folder: Path) -> None:
    tamper(database(folder), "DELETE FROM audit WHERE number > 5")


def empty(folder: Path) -> None:
    tamper(database(folder), "DELETE FROM audit")


def made_anew(folder: Path, change: Callable[[list[Event]], list[Event]]) -> None:
    """Write the chain as it would be if other events had come."""
    (part,) = parts_in(audit_folder(folder))
    events = [entry.event for entry in part.entries()]
    for path in audit_folder(folder).glob("*.sqlite*"):
        path.unlink()
    writer = AuditWriter(database(folder), GENESIS)
    writer.append(change(events))
    writer.close()


def without_an_owner(folder: Path) -> None:
    made_anew(folder, lambda events: [one for one in events if one.request_id != "r3"])


def with_another_event(folder: Path) -> None:
    made_anew(folder, lambda events: [event(99), *events[1:]])


def begun_anew(folder: Path) -> None:
    for path in audit_folder(folder).glob("*.sqlite*"):
        path.unlink()
    written(folder, 2)


TAMPERING = {
    one.__name__: one
    for one in (cut_the_end, empty, without_an_owner, with_another_event, begun_anew)
}


def verified(folder: Path, *words: object) -> tuple[int, str]:
    done = audit("verify", *map(str, words), "--data-dir", str(folder))
    return done.exit_code, done.output


@pytest.mark.every(3)
@pytest.mark.parametrize("kind", TAMPERING)
@pytest.mark.parametrize("kept", ["beside it", "backup", "service log", "journal"])
def test_what_is_gone_shows_by_what_was_noted(
    tmp_path: Path, kind: str, kept: str, caplog: pytest.LogCaptureFixture
) -> None:
    data, notes = tmp_path / "data", tmp_path / "notes"
    (data / "models").mkdir(parents=True)
    with caplog.at_level(logging.INFO):
        written(data, N)
    if kept == "backup":
        backup(data, notes)
    elif kept == "journal":
        notes.write_text(f"Nov 22 host: {audit('note', '--data-dir', str(data)).output}")
    elif kept == "service log":
        notes.write_text("\n".join(str(vars(record).get("head")) for record in caplog.records))
    words = [] if kept == "beside it" else ["--notes", notes]
    assert verified(data, *words)[0] == 0
    TAMPERING[kind](data)
    if kept != "beside it":
        # By somebody who can write to the whole folder.
        (audit_folder(data) / "heads").unlink()
    code, text = verified(data, *words)
    assert code == 1
    assert "was noted" in text
    assert "whole" not in text


def test_nothing_noted_is_said(tmp_path: Path) -> None:
    written(tmp_path, 3)
    (audit_folder(tmp_path) / "heads").unlink()
    code, text = verified(tmp_path)
    assert code == 0
    assert "No head was noted" in text


def test_heads_are_noted_at_the_end_of_each_file_and_of_the_log(tmp_path: Path) -> None:
    with AuditLog(tmp_path, 3) as log:
        for number in range(7):
            log.append([event(number)])
        assert [head.number for head in heads_of(audit_folder(tmp_path))] == [3, 6]
        assert log.note_head().number == 7
        assert log.note_head().number == 7
    assert [head.number for head in heads_of(audit_folder(tmp_path))] == [3, 6, 7]
    assert verified(tmp_path)[0] == 0


def test_a_service_notes_the_head_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("modalmotion_service.audit.log._NOTE_SECONDS", 0.05)
    folder = audit_folder(tmp_path)
    with guarded(tmp_path) as service:
        for number in (1, 2):
            service.ask("lab", "GET", "/v1/limits")
            for _ in range(200):
                if heads_of(folder)[-1:] and heads_of(folder)[-1].number == number:
                    break
                # The hour passes in another task.
                service.client.get("/health/live")
            assert heads_of(folder)[-1].number == number
    assert verified(tmp_path)[0] == 0


def test_a_torn_line_is_passed_over_and_the_next_is_whole(tmp_path: Path) -> None:
    first, second = Place(1, "a" * 64), Place(2, "b" * 64)
    assert note_head(tmp_path, first)
    assert not note_head(tmp_path, first)
    with (tmp_path / "heads").open("a") as file:
        file.write("2026-11-22T14:00:00.000000Z 2:bbbb")
    assert note_head(tmp_path, second)
    assert places_in(tmp_path / "heads") == [first, second]


def test_a_backup_does_not_take_heads_that_were_cut_short(tmp_path: Path) -> None:
    data, copy = tmp_path / "data", tmp_path / "copy"
    (data / "models").mkdir(parents=True)
    written(data, N)
    assert backup(data, copy).missing == ()
    written(data, 1)
    assert backup(data, copy).missing == ()
    log = (copy / "access" / "audit" / "000000000001.sqlite").read_bytes()
    cut_the_end(data)
    heads = audit_folder(data) / "heads"
    heads.write_text(heads.read_text().splitlines()[0] + "\n")
    assert backup(data, copy).missing == ("access/audit/heads",)
    assert len(heads_of(audit_folder(copy))) == 2
    # Nor is the log that it had before.
    assert (copy / "access" / "audit" / "000000000001.sqlite").read_bytes() == log
    assert verified(copy)[0] == 0
    assert verified(data, "--notes", copy)[0] == 1


def test_a_copy_of_a_log_reaches_as_far_as_its_heads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data, copy = tmp_path / "data", tmp_path / "copy"
    (data / "models").mkdir(parents=True)
    written(data, 2)
    real = sqlite3.connect

    def connect(*values: object, **options: object) -> sqlite3.Connection:
        # Something happens between the two, as while a service runs.
        monkeypatch.setattr(sqlite3, "connect", real)
        written(data, 1)
        return real(*values, **options)  # type: ignore[call-overload, no-any-return]

    monkeypatch.setattr(sqlite3, "connect", connect)
    backup(data, copy)
    written(data, 1)
    assert verified(copy)[0] == 0
    assert verified(data, "--notes", copy)[0] == 0


@pytest.mark.parametrize("entries", ["kept", "gone"])
@pytest.mark.parametrize("heads", ["empty", "cut", "gone"])
def test_a_log_without_its_heads_is_not_called_whole(
    tmp_path: Path, entries: str, heads: str
) -> None:
    written(tmp_path, N)
    assert verified(tmp_path)[0] == 0
    path = audit_folder(tmp_path) / "heads"
    if entries == "gone":
        empty(tmp_path)
    if heads == "gone":
        path.unlink()
    else:
        path.write_bytes(b"" if heads == "empty" else path.read_bytes()[:30])
    status, output = verified(tmp_path)
    if (entries, heads) == ("kept", "gone"):
        # As a log that was written before there were heads.
        assert (status, "No head was noted" in output) == (0, True)
    else:
        assert (status, "heads beside the log are gone" in output) == (1, True)
