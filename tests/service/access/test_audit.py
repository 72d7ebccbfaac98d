"""The audit log: everything of consequence is in it before the answer leaves."""

from __future__ import annotations

import asyncio
import json
import multiprocessing
import os
from pathlib import Path

import pytest
from access_parts import NOBODYS, Guarded, guarded, json_body
from click.testing import CliRunner, Result

from modalmotion.cli import main
from modalmotion.errors import StoreError
from modalmotion_service.access.audit import BEGUN, AuditLog, Event, note_key
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import SCOPE_OF, Scope
from modalmotion_service.commands.server import offer_first_key
from modalmotion_service.settings import Settings


def event(number: int = 0, status: int = 200) -> Event:
    return Event(f"r{number}", "lab", "0" * 16, "127.0.0.1", "GET", "/v1/sequences", "", status)


def audit(*words: str) -> Result:
    return CliRunner().invoke(main, ["audit", *words])


def disk_is_full(*_: object) -> None:
    raise StoreError("The disk is full.", details={"errno": "ENOSPC"})


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
        service.ask("lab", "GET", f"/v1/signatures/{known}/distance?to={'0' * 64}")
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
        ("lab", "POST", "/v1/sequences", [], BEGUN),
        ("lab", "POST", "/v1/sequences", [known], 201),
        ("lab", "GET", of, [known], 200),
        ("lab", "GET", of, [known], 200),
        ("lab", "POST", "/v1/signatures/query", [], BEGUN),
        ("lab", "POST", "/v1/signatures/query", [known], 200),
        ("lab", "GET", "/v1/signatures/{key}/distance", [known, "0" * 64], 404),
        ("other", "GET", of, [known], 404),
        ("lab", "DELETE", of, [known], 403),
        (None, "GET", of, [known], 401),
        ("lab", "GET", of, [], 422),
    ]
    assert found[0]["request_id"] == found[1]["request_id"] != found[2]["request_id"]
    assert (found[0]["key_id"], found[2]["request_id"]) == (key_id, "mine-1")
    assert found[9]["key_id"] is None
    assert "Jane" not in json.dumps(found)


def test_an_ended_key_is_named_and_a_template_too(tmp_path: Path, beat: bytes) -> None:
    with guarded(tmp_path) as service:
        here = service.ask("lab", "POST", "/v1/sequences", content=beat).headers["location"]
        template = service.ask("lab", "POST", "/v1/templates", content=beat).json()["id"]
        named = {"template": template, "modes": 4}
        service.ask("lab", "POST", f"{here}/signatures", json=named)
        service.ask("lab", "POST", f"{here}/signatures", json={"template": "Jane-Doe"})
        key_id = service.token("lab")[3:19]
        with KeyRing(tmp_path) as ring:
            ring.revoke(key_id)
        refused = service.ask("lab", "GET", here)
        forged = {"Authorization": f"Bearer mm_{key_id}_{'A' * 43}"}
        service.client.get(here, headers=forged)
        found = entries(service)
    assert (refused.status_code, key_id in refused.text) == (401, False)
    # Whoever knows only a key's id has not shown that it is theirs.
    assert [(one["status"], one["owner"], one["key_id"]) for one in found[:2]] == [
        (401, None, None),
        (401, None, key_id),
    ]
    assert found[2]["ids"] == [here.rpartition("/")[2]]
    assert found[4]["ids"] == [here.rpartition("/")[2], template]


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


def test_nothing_is_changed_that_cannot_be_noted(
    tmp_path: Path, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    with guarded(tmp_path) as service:
        here = service.ask("lab", "POST", "/v1/sequences", content=beat).headers["location"]
        monkeypatch.setattr(AuditLog, "append", disk_is_full)
        assert service.ask("lab", "DELETE", here).status_code == 507
        assert service.ask("lab", "POST", "/v1/sequences", content=beat[:100]).status_code == 507
        monkeypatch.undo()
        assert service.ask("lab", "GET", here).status_code == 200


@pytest.mark.parametrize("scope", [Scope.WRITE, Scope.TRAIN])
def test_who_was_about_to_change_what_is_noted_before(
    tmp_path: Path, scope: Scope, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crash between a change and its entry leaves a trace; reading leaves one entry."""
    noted: list[tuple[str, str, int]] = []
    append = AuditLog.append

    def seen(log: AuditLog, events: list[Event]) -> None:
        noted.extend((event.method, event.route, event.status) for event in events)
        append(log, events)

    with guarded(tmp_path) as service:
        token = service.token("lab", *Scope)
        monkeypatch.setattr(AuditLog, "append", seen)
        calls = [call for call, needed in SCOPE_OF.items() if needed is scope]
        assert calls
        for method, template in calls:
            del noted[:]
            path = template.format(**NOBODYS)
            client, header = service.client, {"Authorization": f"Bearer {token}"}
            answer = client.request(method, path, headers=header)
            assert noted == [(method, template, BEGUN), (method, template, answer.status_code)]


def test_no_data_leaves_when_it_cannot_be_noted(
    tmp_path: Path, beat: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    with guarded(tmp_path) as service:
        here = service.ask("lab", "POST", "/v1/sequences", content=beat).headers["location"]
        monkeypatch.setattr(AuditLog, "append", disk_is_full)
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
        assert [entry.request_id for entry in log.page(limit=200)] == [
            f"r{number}" for number in range(199, -1, -1)
        ]
        assert sum(batches) == 200
        assert len(batches) <= 3


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


def test_the_command_shows_entries_as_lines(tmp_path: Path) -> None:
    with AuditLog(tmp_path) as log:
        log.append([event(number) for number in range(3)])
    lines = audit("show", "--limit", "2", "--data-dir", str(tmp_path)).output.splitlines()
    assert [json.loads(line)["number"] for line in lines] == [3, 2]
    assert audit("show", "--owner", "x", "--data-dir", str(tmp_path)).output == ""


def test_what_is_done_to_keys_is_noted(tmp_path: Path) -> None:
    def keys(*words: str) -> Result:
        return CliRunner().invoke(main, ["keys", *words, "--data-dir", str(tmp_path)])

    with KeyRing(tmp_path) as ring, AuditLog(tmp_path) as log:
        offer_first_key(Settings(data_dir=tmp_path, require_keys=True), ring, log)
    key_id = keys("create", "--owner", "lab", "--scopes", "read").stdout[3:19]
    assert keys("revoke", "0" * 16).exit_code == 1
    assert keys("revoke", key_id).exit_code == 0
    with AuditLog(tmp_path) as log:
        found = log.page(limit=10)
    assert [(one.owner, one.method, one.route) for one in found] == [
        ("lab", "COMMAND", "keys revoke"),
        ("lab", "COMMAND", "keys create"),
        ("local", "COMMAND", "keys create"),
    ]
    assert [one.ids for one in found[:2]] == [key_id, key_id]
    assert found[0].client == f"command line, uid {os.getuid()}"


def test_a_key_that_cannot_be_noted_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(AuditLog, "append", disk_is_full)
    with KeyRing(tmp_path) as ring, AuditLog(tmp_path) as log:
        with pytest.raises(StoreError):
            note_key(ring.create("lab", [Scope.READ]), ring, log)
        assert [key.state for key in ring.all()] == ["revoked"]


def test_entries_whose_time_has_passed_go_and_numbers_go_on(tmp_path: Path) -> None:
    _write(tmp_path, 4)
    with AuditLog(tmp_path) as log:
        log.forget_before(1.0)
        assert len(log.page(limit=9)) == 4
        log.forget_before(-1.0)
        log.append([event(9)])
        assert [entry.number for entry in log.page(limit=9)] == [5]


def _write(folder: Path, n: int) -> None:
    with AuditLog(folder) as log:
        for number in range(n):
            log.append([event(number)])


def test_two_processes_write_one_log(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=_write, args=(tmp_path, 40)) for _ in range(2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    with AuditLog(tmp_path) as log:
        found = log.page(limit=100)
    assert [entry.number for entry in found] == [*range(80, 0, -1)]
    assert sorted(entry.request_id for entry in found) == sorted(2 * [f"r{n}" for n in range(40)])


def test_changes_without_an_end_are_found(tmp_path: Path) -> None:
    begun = [event(1, BEGUN), event(2, BEGUN), event(2), event(3), event(4, BEGUN), event(4, BEGUN)]
    with AuditLog(tmp_path) as log:
        for one in [*begun, event(4, 201), event(5, 500)]:
            log.append([one])
        assert [entry.number for entry in log.unfinished()] == [1, 6]
    lines = audit("unfinished", "--data-dir", str(tmp_path)).output.splitlines()
    assert [json.loads(line)["number"] for line in lines] == [1, 6]
