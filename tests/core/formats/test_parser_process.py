"""Parsers that are forked: what they see, how they end, and who learns of it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from format_samples import sequence
from hostile_parsers import TASKS

from modalmotion.errors import MalformedFileError
from modalmotion.formats import DEFAULT_LIMITS, ParserHere, write_vtkhdf
from modalmotion.formats import parser_child as child
from modalmotion.formats.parser_child import landlock_version
from modalmotion.formats.parser_process import (
    ParserForks,
    ParserLostError,
    ParserProcess,
    parser_of_thread,
)


@pytest.fixture
def forks(monkeypatch: pytest.MonkeyPatch) -> Iterator[ParserForks]:
    for name, place in TASKS.items():
        monkeypatch.setitem(child._TASKS, name, (place,))
    made = ParserForks()
    yield made
    made.close()


def tell(forks: ParserForks, path: str = "/etc/passwd") -> dict[str, object]:
    return forks.parse("tell", path.encode(), DEFAULT_LIMITS).info


def is_gone(pid: int) -> bool:
    end = time.monotonic() + 20
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    return False


def test_it_parses_as_one_here_does(forks: ParserForks) -> None:
    data = write_vtkhdf(sequence())
    here = ParserHere(DEFAULT_LIMITS).parse("hdf5", data)
    there = forks.parse("hdf5", data, DEFAULT_LIMITS)
    assert (there.arrays["vertices"] == here.arrays["vertices"]).all()
    with pytest.raises(MalformedFileError):
        forks.parse("hdf5", data[:1000], DEFAULT_LIMITS)
    assert forks.parse("hdf5", data, DEFAULT_LIMITS).info == there.info


@pytest.mark.skipif(not landlock_version(), reason="this system has no Landlock")
def test_it_sees_no_file_and_none_of_its_parents(forks: ParserForks, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("of somebody")
    seen = tell(forks, str(tmp_path / "secret"))
    assert seen["text"] == "PermissionError"
    assert not seen["traced"]
    # Standard ones, the socket, and the list itself.
    assert isinstance(seen["files"], int)
    assert seen["files"] <= 5


def test_one_lives_until_it_is_ended(forks: ParserForks) -> None:
    first = tell(forks)["pid"]
    assert tell(forks)["pid"] == first
    forks.end_parser()
    assert isinstance(first, int)
    assert is_gone(first)
    assert tell(forks)["pid"] not in (first, forks.pid, os.getpid())
    forks.end_parser()
    forks.end_parser()


@pytest.mark.parametrize("how", [signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS])
def test_a_file_that_ends_its_parser_is_damaged(forks: ParserForks, how: signal.Signals) -> None:
    with pytest.raises(MalformedFileError, match="crashed"):
        forks.parse("end", b"%d" % how, DEFAULT_LIMITS)
    assert tell(forks)["pid"]


def test_an_answer_that_is_not_one_is_a_damaged_file(forks: ParserForks) -> None:
    with pytest.raises(MalformedFileError, match="crashed"):
        forks.parse("lie", b"", DEFAULT_LIMITS)
    assert tell(forks)["pid"]


def test_a_parser_that_is_killed_says_nothing_of_its_file(forks: ParserForks) -> None:
    pid = tell(forks)["pid"]
    assert isinstance(pid, int)
    os.kill(pid, signal.SIGKILL)
    with pytest.raises(ParserLostError):
        tell(forks)
    with pytest.raises(ParserLostError):
        forks.parse("end", b"%d" % signal.SIGKILL, DEFAULT_LIMITS)


def test_with_the_process_that_forks_them_parsers_end_too(forks: ParserForks) -> None:
    pid = tell(forks)["pid"]
    assert isinstance(pid, int)
    os.kill(forks.pid, signal.SIGKILL)
    assert is_gone(pid)
    with pytest.raises(ParserLostError):
        tell(forks)
    with pytest.raises(ParserLostError):
        tell(forks)


def test_one_that_was_ended_between_files_says_nothing_of_the_next() -> None:
    image = write_vtkhdf(sequence())
    with ParserProcess(DEFAULT_LIMITS) as parser:
        parser.parse("hdf5", image)
        first = parser._child
        assert first is not None
        first.kill()
        first.wait()
        assert parser.parse("hdf5", image).arrays["vertices"].any()


def test_a_fork_has_a_parser_of_its_own() -> None:
    own = parser_of_thread(DEFAULT_LIMITS)
    assert parser_of_thread(DEFAULT_LIMITS) is own
    pid = os.fork()
    if not pid:
        os._exit(parser_of_thread(DEFAULT_LIMITS) is own)
    assert os.waitpid(pid, 0)[1] == 0
