"""Answers of workers: what is written comes back, and nothing else is taken."""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import pickle
import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from modalmotion.errors import NonFiniteError
from modalmotion_service.errors import ClusterError, WorkerDiedError
from modalmotion_service.work.answers import (
    AnswerError,
    TaskError,
    answer_of,
    error_to_bytes,
    from_bytes,
    result_type,
    to_bytes,
)
from modalmotion_service.work.forks import FORKS
from modalmotion_service.work.pool import WorkerPool


class Colour(StrEnum):
    RED = "red"


class Described(BaseModel):
    count: int
    names: list[str]


@dataclass(frozen=True, eq=False)
class Inner:
    values: tuple[float, ...]
    name: str | None = None


@dataclass(frozen=True, eq=False)
class Outer:
    parts: tuple[Inner, ...]
    pair: tuple[int, bytes]
    shares: dict[str, float]
    colour: Colour
    path: Path
    described: Described | None
    flags: tuple[str, ...] = ()
    anything: dict[str, Any] = field(default_factory=dict)


def sample() -> Outer:
    return Outer(
        parts=(Inner((0.0, 1.5, np.float64(2.0)), "a"), Inner(())),
        pair=(3, b"\x00\xff"),
        shares={"a": 0.1, "b": float("inf")},
        colour=Colour.RED,
        path=Path("folder/file"),
        described=Described(count=2, names=["x"]),
        anything={"a": [1, {"b": None}]},
    )


def test_everything_that_a_task_answers_comes_back() -> None:
    value = sample()
    back = from_bytes(to_bytes(value), Outer)
    assert isinstance(back, Outer)
    assert back.pair == value.pair
    assert back.shares == value.shares
    assert (back.colour, back.path, back.described) == (Colour.RED, value.path, value.described)
    assert back.anything == value.anything
    assert [part.name for part in back.parts] == ["a", None]
    assert [part.values for part in back.parts] == [part.values for part in value.parts]


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    )
)
def test_plain_values_come_back(value: object) -> None:
    assert from_bytes(to_bytes(value), Any) == value


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (3, str),
        ("three", int),
        ([1, 2], tuple[int, int, int]),
        ({"a": "b"}, dict[str, float]),
        ("blue", Colour),
        (None, bytes),
        ({"values": 3, "name": None}, Inner),
        ({"other": 3}, Inner),
        ({"count": "many", "names": []}, Described),
        (3, None),
    ],
)
def test_what_is_of_another_type_is_refused(value: object, expected: object) -> None:
    with pytest.raises(AnswerError):
        from_bytes(to_bytes(value), expected)


class Hostile:
    """Leaves a mark where it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, (str(self.mark),)


def test_a_pickle_is_not_an_answer(tmp_path: Path) -> None:
    payload = pickle.dumps(Hostile(tmp_path / "mark"))
    framed = len(payload).to_bytes(8, "little") + payload
    for data in (payload, framed, to_bytes(payload)):
        for expected in (Outer, Any, bytes):
            with contextlib.suppress(AnswerError):
                from_bytes(data, expected)
    assert not (tmp_path / "mark").exists()
    with pytest.raises(AnswerError):
        to_bytes(Hostile(tmp_path / "mark"))


@pytest.mark.parametrize(
    "details",
    [{"name": "a\ud800.vtk"}, {"name": b"\xff"}, {"least": np.int64(3), "most": float("inf")}],
)
def test_errors_name_whatever_a_file_contains(details: dict[str, Any]) -> None:
    error = NonFiniteError("'a\ud800.vtk' is not there.", remedy="Send it.", details=details)
    with pytest.raises(NonFiniteError, match="\ud800"):
        from_bytes(error_to_bytes(error), Any)


@given(st.data())
def test_damaged_answers_are_refused_or_read(data: st.DataObject) -> None:
    image = bytearray(to_bytes(sample()))
    for _ in range(data.draw(st.integers(1, 4))):
        image[data.draw(st.integers(0, len(image) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(image)))
    for damaged in (bytes(image), bytes(image[:cut])):
        with contextlib.suppress(AnswerError):
            assert isinstance(from_bytes(damaged, Outer), Outer)


def test_errors_of_ours_keep_their_data() -> None:
    sent = NonFiniteError("text", remedy="advice", frame=3, vertex=4, details={"count": 1})
    with pytest.raises(NonFiniteError) as caught:
        from_bytes(error_to_bytes(sent), Any)
    assert vars(caught.value) == vars(sent)
    with pytest.raises(ClusterError, match="text"):
        from_bytes(error_to_bytes(ClusterError("text")), Any)


def test_other_errors_are_no_classes_that_a_worker_chooses() -> None:
    def fail() -> None:
        raise KeyError("inside")

    with pytest.raises(TaskError, match="KeyError"):
        from_bytes(answer_of(fail, (), {}), None)
    for name in ("SystemExit", "ModalMotionError.__init__", "__builtins__", "annotations"):
        state = dict.fromkeys(("remedy", "frame", "vertex", "limit"), None)
        forged = b"!" + json.dumps([name, {"message": "m", **state, "details": {}}]).encode()
        with pytest.raises((TaskError, AnswerError)):
            from_bytes(forged, Any)
    with pytest.raises(MemoryError):
        from_bytes(error_to_bytes(MemoryError()), Any)
    with pytest.raises(OSError, match="device") as caught:
        from_bytes(error_to_bytes(OSError(28, "no space left on device", "file")), Any)
    assert (caught.value.errno, caught.value.filename) == (28, "file")


def test_every_task_of_the_service_states_its_result() -> None:
    from modalmotion_service.work import tasks

    folder = Path(str(tasks.__file__)).parent
    # What lies in `files` are helpers of tasks.
    names = {path.stem for path in folder.glob("[a-z]*.py")} - {"files"}
    modules = [f"{tasks.__name__}.{name}" for name in names]
    n_tasks = 0
    for name in modules:
        module = __import__(name, fromlist=["_"])
        for function in vars(module).values():
            is_here = inspect.isfunction(function) and function.__module__ == name
            if is_here and not function.__name__.startswith("_"):
                assert result_type(function) is not Any, function
                n_tasks += 1
    assert n_tasks > 15


class HostileWorker:
    """A worker that says what it likes: it speaks for a process that was taken over."""

    def __init__(self, answer: bytes) -> None:
        self._answer = answer
        self.n_answers = 0

    def serve(self, ours: socket.socket) -> None:
        def speak() -> None:
            with ours, contextlib.suppress(OSError):
                # It is there: an answer of nothing.
                ours.sendall(bytes(8))
                while ours.recv(1 << 16):
                    # Counted first: whoever reads the answer may look before this thread goes on.
                    self.n_answers += 1
                    ours.sendall(len(self._answer).to_bytes(8, "little") + self._answer)

        threading.Thread(target=speak, daemon=True).start()


def test_a_hostile_worker_runs_nothing_here(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    worker = HostileWorker(pickle.dumps(Hostile(tmp_path / "mark")))

    def fork(theirs: socket.socket, *_: object) -> int:
        worker.serve(theirs.dup())
        # The number of no process.
        return 0

    monkeypatch.setattr(FORKS, "fork", fork)
    unread = pytest.raises(WorkerDiedError, match="unreadable answer")
    with WorkerPool(1, 5.0, 10**9) as pool, unread:
        pool.submit(os.getpid).result(timeout=30)
    assert worker.n_answers
    assert not (tmp_path / "mark").exists()
