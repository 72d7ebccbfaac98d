"""The audit log as lines: on a stream, to a log host, as FHIR."""

from __future__ import annotations

import asyncio
import json
import os
import re
import socket
from dataclasses import asdict
from pathlib import Path

import pytest

from modalmotion.errors import StoreError
from modalmotion_service.access.audit import AuditLog, Event, Lines


def event(number: int) -> Event:
    return Event(f"r{number}", "alice", "k", "127.0.0.1", "GET", "/v1/limits", "", 200)


def test_lines_alone_are_numbered_by_each_start(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    for _ in range(2):
        with AuditLog(None, Lines(str(path))) as stream:

            async def note(to: AuditLog = stream) -> None:
                await asyncio.gather(*(to.note(event(n)) for n in range(5)))
                await to.drain()

            asyncio.run(note())
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert len(lines) == 10
    first, second = lines[:5], lines[5:]
    assert first[0]["audit"] != second[0]["audit"]
    for of_start in (first, second):
        assert [line["number"] for line in of_start] == [1, 2, 3, 4, 5]
        for number, line in enumerate(of_start):
            assert asdict(event(number)).items() <= line.items()


def test_what_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    for target in (str(tmp_path / "none" / "lines"), f"syslog://{tmp_path}/none"):
        with pytest.raises(StoreError, match="AUDIT_STREAM"):
            Lines(target)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with AuditLog(tmp_path, Lines(str(pipe))) as log:
        log.append([event(0)])
        os.close(reader)
        with pytest.raises(StoreError, match="audit log"):
            log.append([event(1)])


def test_each_entry_of_the_table_is_a_line_too(tmp_path: Path) -> None:
    with AuditLog(tmp_path, Lines(str(tmp_path / "lines"))) as log:
        log.append([event(0), event(1)])
        log.append([event(2)])
        entries = log.page(limit=9)[::-1]
    lines = [json.loads(line) for line in (tmp_path / "lines").read_text().splitlines()]
    assert lines == [{"audit": "table", **asdict(entry)} for entry in entries]


def test_a_log_host_gets_lines_and_may_be_begun_anew(tmp_path: Path) -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as host,
        AuditLog(None, Lines(f"syslog://127.0.0.1:{host.getsockname()[1]}")) as stream,
    ):
        said = []
        with host.accept()[0] as connection:
            for number in range(2):
                stream.append([event(number)])
                said.append(connection.recv(4096).decode())
        # What is sent into a connection that its end has closed is known to be lost at the next.
        for number in range(2, 4):
            stream.append([event(number)])
        with host.accept()[0] as connection:
            said.append(connection.recv(4096).decode())
    assert said[0].startswith("<110>1 - ")
    assert [json.loads(text[text.index("{") :])["request_id"] for text in said[:2]] == ["r0", "r1"]
    assert said[2].count("<110>") >= 1


def test_the_syslog_of_this_machine_gets_a_message_each(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as log:
        log.bind(str(tmp_path / "log"))
        with AuditLog(None, Lines(f"syslog://{tmp_path}/log")) as stream:
            stream.append([event(0), event(1)])
        said = [log.recv(4096).decode() for _ in range(2)]
    assert all(text.startswith("<110>modalmotion: {") for text in said)


@pytest.mark.parametrize(
    ("method", "status", "action", "outcome"),
    [
        ("GET", 200, "R", "0"),
        ("POST", 102, "C", "0"),
        ("DELETE", 404, "D", "4"),
        ("COMMAND", 507, "E", "8"),
    ],
)
def test_a_line_may_be_an_audit_event_of_fhir(
    tmp_path: Path, method: str, status: int, action: str, outcome: str
) -> None:
    path = tmp_path / "lines"
    done = Event("r0", "alice", "k", "10.0.0.1", method, "/v1/sequences", "ab cd", status)
    with AuditLog(None, Lines(str(path), "fhir")) as stream:
        stream.append([done])
    line = json.loads(path.read_text())
    assert re.fullmatch(r"[0-9a-f]{16}-1-[A-Za-z0-9.-]{1,40}", line["id"])
    # What R4 requires: type, recorded, agent with requestor, source with observer.
    assert (line["resourceType"], line["type"]["code"]) == ("AuditEvent", "rest")
    assert (line["action"], line["outcome"]) == (action, outcome)
    assert line["agent"][0]["requestor"] is True
    assert line["agent"][0]["who"]["identifier"]["value"] == "alice"
    assert line["source"]["observer"]
    assert [one["what"]["identifier"]["value"] for one in line["entity"]] == ["ab", "cd", "r0"]
    assert line["recorded"].endswith("Z")
