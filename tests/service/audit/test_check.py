"""What was in the audit log once shows that it is gone, whoever writes its file anew."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable
from pathlib import Path

import pytest
from audit_parts import audit, event, tamper, written

from modalmotion_service.audit.entry import BEGUN, GENESIS, Event, chained
from modalmotion_service.audit.log import AuditLog, audit_path, entries_of, faults_of, unfinished

TAMPERING = {
    "another id": (
        "UPDATE audit SET ids = 'x' WHERE number = 4",
        "entry 4 is not what was written",
    ),
    "another time": (
        "UPDATE audit SET time = '2000' WHERE number = 1",
        "entry 1 is not what was written",
    ),
    "one taken out": ("DELETE FROM audit WHERE number = 4", "entries 4 to 4 are missing"),
    "the first taken out": ("DELETE FROM audit WHERE number = 1", "entries 1 to 1 are missing"),
    "two exchanged": (
        "".join(
            f"UPDATE audit SET number = {new} WHERE number = {old};"  # noqa: S608 (numbers)
            for old, new in ((4, 99), (5, 4), (99, 5))
        ),
        "entry 4 is not what was written",
    ),
    "one taken out and the others renumbered": (
        "DELETE FROM audit WHERE number = 4; UPDATE audit SET number = number - 1 WHERE number > 4",
        "entry 4 is not what was written",
    ),
    "all taken out": ("DELETE FROM audit", "there is no entry"),
}


@pytest.mark.parametrize("kind", TAMPERING)
def test_tampering_shows(tmp_path: Path, kind: str) -> None:
    script, says = TAMPERING[kind]
    written(tmp_path, 8)
    assert audit("verify", "--data-dir", str(tmp_path)).exit_code == 0
    tamper(tmp_path, script)
    found = audit("verify", "--data-dir", str(tmp_path))
    assert found.exit_code == 1
    assert says in found.output


def made_anew(folder: Path, change: Callable[[list[Event]], list[Event]]) -> None:
    """Write the chain as it would be if other events had come."""
    events = [entry.event for entry in entries_of(audit_path(folder))]
    for path in audit_path(folder).parent.glob("audit.sqlite*"):
        path.unlink()
    with AuditLog(folder) as log:
        log.append(change(events))


REWRITING: dict[str, tuple[Callable[[Path], None], str]] = {
    "the end cut": (
        lambda folder: tamper(folder, "DELETE FROM audit WHERE number > 5"),
        "its end is gone",
    ),
    "an owner left out": (
        lambda folder: made_anew(folder, lambda events: events[:3] + events[4:]),
        "is not the one that was handed on",
    ),
    "another event": (
        lambda folder: made_anew(folder, lambda events: [event(99), *events[1:]]),
        "is not the one that was handed on",
    ),
    "begun anew": (lambda folder: made_anew(folder, lambda _: [event(7)]), "its end is gone"),
}


@pytest.mark.parametrize("kind", REWRITING)
def test_what_a_chain_cannot_show_the_lines_show(tmp_path: Path, kind: str) -> None:
    lines = tmp_path / "lines"
    written(tmp_path, 8, lines)
    # As a log host keeps it: with heads, other lines, and one that was cut.
    kept = [f"Nov 26 host modalmotion: {line}" for line in lines.read_text().splitlines()]
    lines.write_text("\n".join(["other {", *kept, '{"audit": "table", "num']))
    where = ("--lines", str(lines), "--data-dir", str(tmp_path))
    whole = audit("verify", *where)
    assert (whole.exit_code, "8 entries: whole" in whole.output) == (0, True)
    rewrite, says = REWRITING[kind]
    rewrite(tmp_path)
    alone = audit("verify", "--data-dir", str(tmp_path))
    assert (alone.exit_code, "cannot be told" in alone.output) == (0, True)
    found = audit("verify", *where)
    assert (found.exit_code, says in found.output) == (1, True)


def test_an_entry_depends_on_everything_in_it_and_before_it() -> None:
    first = chained(1, GENESIS, "t", event())
    others = [
        chained(1, "1" * 64, "t", event()),
        chained(2, GENESIS, "t", event()),
        chained(1, GENESIS, "u", event()),
        chained(1, GENESIS, "t", event(1)),
    ]
    assert len({first.sha256, *(other.sha256 for other in others)}) == 5


def test_entries_whose_time_has_passed_go_and_the_chain_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path, 4)
    with AuditLog(tmp_path) as log:
        log.forget_before(1.0)
        assert len(log.page(limit=9)) == 4
        # The last one stays, whatever its age.
        log.forget_before(-1.0)
        log.append([event(9)])
        assert [entry.number for entry in log.page(limit=9)] == [5, 4]
    assert faults_of(entries_of(audit_path(tmp_path)), {}, forgets=True) == (2, [])
    assert audit("verify", "--data-dir", str(tmp_path)).exit_code == 1
    monkeypatch.setenv("MODALMOTION_AUDIT_DAYS", "365")
    assert audit("verify", "--data-dir", str(tmp_path)).exit_code == 0


def _write(folder: Path, n: int) -> None:
    written(folder, n)


def test_two_processes_write_one_chain(tmp_path: Path) -> None:
    written(tmp_path, 1)
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=_write, args=(tmp_path, 40)) for _ in range(2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    assert faults_of(entries_of(audit_path(tmp_path)), {}) == (81, [])


def test_changes_without_an_end_are_found(tmp_path: Path) -> None:
    begun = [event(1, BEGUN), event(2, BEGUN), event(2), event(3), event(4, BEGUN), event(4, BEGUN)]
    with AuditLog(tmp_path) as log:
        for one in [*begun, event(4, 201), event(5, 500)]:
            log.append([one])
    entries = entries_of(audit_path(tmp_path))
    assert [entry.number for entry in unfinished(entries)] == [1, 6]
    lines = audit("unfinished", "--data-dir", str(tmp_path)).output.splitlines()
    assert [json.loads(line)["number"] for line in lines] == [1, 6]
