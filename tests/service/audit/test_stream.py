"""The audit log as lines on a stream."""

from __future__ import annotations

import asyncio
import json
import os
from dataclasses import asdict
from pathlib import Path

import pytest

from modalmotion.errors import StoreError
from modalmotion_service.audit.entry import GENESIS, Event, chained
from modalmotion_service.audit.stream import AuditStream


def event(number: int) -> Event:
    return Event(f"r{number}", "alice", "k", "127.0.0.1", "GET", "/v1/limits", "", 200)


def test_each_line_ends_a_chain_that_shows_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    for _ in range(2):
        with AuditStream(str(path)) as stream:

            async def note(to: AuditStream = stream) -> None:
                await asyncio.gather(*(to.note(event(n)) for n in range(5)))
                await to.drain()

            asyncio.run(note())
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert len(lines) == 10
    first, second = lines[:5], lines[5:]
    assert first[0]["audit"] != second[0]["audit"]
    for chain in (first, second):
        place = GENESIS
        for number, line in enumerate(chain):
            entry = chained(place, line["time"], event(number))
            assert (line["number"], line["sha256"]) == (entry.number, entry.sha256)
            assert asdict(event(number)).items() <= line.items()
            place = entry.place


def test_what_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="AUDIT_STREAM"):
        AuditStream(str(tmp_path / "none" / "lines"))
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with AuditStream(str(pipe)) as stream:
        stream.append([event(0)])
        os.close(reader)
        with pytest.raises(StoreError, match="audit log"):
            stream.append([event(1)])
