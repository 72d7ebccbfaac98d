"""The audit log: everything of consequence is in it before the answer leaves; tampering shows."""

from __future__ import annotations

import asyncio
import json
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from access_parts import Guarded, guarded, json_body
from click.testing import CliRunner, Result

from modalmotion.cli import main
from modalmotion.errors import StoreError
from modalmotion_service.access.audit import AuditLog
from modalmotion_service.access.audit_entry import GENESIS, Event, chained
from modalmotion_service.access.scopes import Scope


def event(number: int = 0) -> Event:
    return Event(f"r{number}", "lab", "0" * 16, "127.0.0.1", "GET", "/v1/sequences", "", 200)


def audit(*words: str) -> Result:
    return CliRunner().invoke(main, ["audit", *words])


def entries(service: Guarded) -> list[dict[str, object]]:
    listed: list[dict[str, object]] = service.ask("chief", "GET", "/v1/audit").json()["entries"]
    return [entry for entry in listed if entry["owner"] != "chief"]


def test_who_did_what_to_which_id(tmp_path: Path, beat: bytes) -> None:
    with guarded(tmp_path) as service:
        made = service.ask("lab", "POST", "/v1/sequences?subject=Jane%20Doe", content=beat)
        known = made.json()["id"]
        here = f"/v1/sequences/{known}"
        service.ask("lab", "GET", here, headers={"X-Request-ID": "mine-1"})
        service.ask("lab", "GET", here, headers={"If-None-Match": made.headers["etag"]})
        service.ask("lab", "POST", "/v1/signatures/query", **json_body([known]))
        service.ask("lab", "GET", f"{here}/distance?to={'0' * 64}")
        service.ask("other", "GET", here)
        service.ask("lab", "DELETE", here, Scope.READ)
        service.client.get(here)
        service.ask("lab", "GET", "/v1/sequences/Jane-Doe")
        service.client.get("/health/ready")
        service.client.get("/docs")
        service.ask("lab", "GET", "/nowhere")
        found = entries(service)[::-1]
        key_id = service.token("lab")[3:19]
    of = "/v1/sequences/{sequence_id}"
    assert [
        (entry["owner"], entry["method"], entry["route"], entry["ids"], entry["status"])
        for entry in found
    ] == [
        ("lab", "POST", "/v1/sequences", [known], 201),
        ("lab", "GET", of, [known], 200),
        ("lab", "GET", of, [known], 200),
        ("lab", "POST", "/v1/signatures/query", [known], 200),
        ("lab", "GET", f"{of}/distance", [known, "0" * 64], 404),
        ("other", "GET", of, [known], 404),
        ("lab", "DELETE", of, [known], 403),
        (None, "GET", of, [known], 401),
        ("lab", "GET", of, [], 422),
    ]
    assert (found[0]["key_id"], found[1]["request_id"]) == (key_id, "mine-1")
    assert found[7]["key_id"] is None
    assert "Jane" not in json.dumps(found)


def test_without_keys_this_machine_is_noted_too(tmp_path: Path) -> None:
    with guarded(tmp_path, require_keys=False) as service:
        service.client.get("/v1/sequences")
        (entry,) = service.client.get("/v1/audit").json()["entries"]
    assert (entry["owner"], entry["key_id"], entry["status"]) == ("local", None, 200)


def test_pages_go_from_the_newest_to_the_oldest(tmp_path: Path) -> None:
    with guarded(tmp_path) as service:
        for _ in range(5):
            service.ask("lab", "GET", "/v1/limits")
        first = service.ask("chief", "GET", "/v1/audit?limit=3&owner=lab").json()
        path = f"/v1/audit?limit=3&owner=lab&cursor={first['cursor']}"
        rest = service.ask("chief", "GET", path).json()
    numbers = [entry["number"] for entry in first["entries"] + rest["entries"]]
    assert numbers == [5, 4, 3, 2, 1]
    assert rest["cursor"] is None


def test_no_data_leaves_when_it_cannot_be_noted(
    tmp_path: Path, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise StoreError("The disk is full.", details={"errno": "ENOSPC"})

    with guarded(tmp_path) as service:
        here = service.ask("lab", "POST", "/v1/sequences", content=beat).headers["location"]
        monkeypatch.setattr(AuditLog, "append", failing)
        answer = service.ask("lab", "GET", here)
        assert (answer.status_code, answer.json()["code"]) == (507, "store_error")
        assert service.client.get("/health/live").status_code == 200
        monkeypatch.undo()
        assert service.ask("lab", "GET", here).status_code == 200


def test_a_request_that_fails_is_noted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise RuntimeError

    with guarded(tmp_path) as service:
        monkeypatch.setattr("modalmotion.store.ResultStore.list_sequences", broken)
        assert service.ask("lab", "GET", "/v1/sequences").status_code == 500
        assert entries(service)[0]["status"] == 500


def test_what_comes_together_is_written_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batches: list[int] = []
    append = AuditLog.append

    def counted(log: AuditLog, events: list[Event]) -> None:
        batches.append(len(events))
        append(log, events)

    monkeypatch.setattr(AuditLog, "append", counted)

    async def note_many(log: AuditLog) -> None:
        await asyncio.gather(*(log.note(event(number)) for number in range(200)))

    with AuditLog(tmp_path) as log:
        asyncio.run(note_many(log))
        assert [entry.event.request_id for entry in log.page(limit=200)] == [
            f"r{number}" for number in range(199, -1, -1)
        ]
        assert sum(batches) == 200
        assert len(batches) <= 3
        assert log.verify().faults == ()


def test_a_client_that_goes_away_takes_no_entry_with_it(tmp_path: Path) -> None:
    async def leave(log: AuditLog) -> None:
        task = asyncio.create_task(log.note(event(1)))
        await asyncio.sleep(0)
        task.cancel()
        await log.note(event(2))
        await log.drain()

    with AuditLog(tmp_path) as log:
        asyncio.run(leave(log))
        assert len(log.page(limit=10)) == 2


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
    with AuditLog(tmp_path) as log:
        log.append([event(number) for number in range(8)])
    assert audit("verify", "--data-dir", str(tmp_path)).exit_code == 0
    path = tmp_path / "access" / "audit.sqlite"
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
    with AuditLog(tmp_path / "a") as log:
        log.append([event(number) for number in range(5)])
        noted = log.verify()
    with AuditLog(tmp_path / "a") as log:
        log.append([event(5)])
        assert log.verify((5, noted.head)).faults == ()
    with AuditLog(tmp_path / "b") as log:
        log.append([event(number) for number in range(4)])
    anchor = f"{noted.n_entries}:{noted.head}"
    here = ("--noted", anchor, "--data-dir")
    assert audit("verify", *here, str(tmp_path / "a")).exit_code == 0
    cut = audit("verify", *here, str(tmp_path / "b"))
    assert (cut.exit_code, "entry 5 with the digest" in cut.output) == (1, True)
    assert audit("verify", "--noted", "5", "--data-dir", str(tmp_path / "a")).exit_code == 2
    assert audit("verify", "--data-dir", str(tmp_path / "nothing")).exit_code == 1


def test_the_command_shows_entries_as_lines(tmp_path: Path) -> None:
    with AuditLog(tmp_path) as log:
        log.append([event(number) for number in range(3)])
    lines = audit("show", "--limit", "2", "--data-dir", str(tmp_path)).output.splitlines()
    assert [json.loads(line)["number"] for line in lines] == [3, 2]
    assert audit("show", "--owner", "x", "--data-dir", str(tmp_path)).output == ""


def test_an_entry_depends_on_everything_in_it_and_before_it() -> None:
    first = chained(GENESIS, 1, "t", event())
    others = [
        chained("1" * 64, 1, "t", event()),
        chained(GENESIS, 2, "t", event()),
        chained(GENESIS, 1, "u", event()),
        chained(GENESIS, 1, "t", event(1)),
    ]
    assert len({first.sha256, *(other.sha256 for other in others)}) == 5
