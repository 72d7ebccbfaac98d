"""Parsers in processes of their own: what they see, how they end, and who learns of it."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import hostile_parsers
import pytest
from format_samples import sequence

from modalmotion.errors import LimitError, MalformedFileError, StoreError
from modalmotion.formats import DEFAULT_LIMITS, ParserHere, parser_process, write_vtkhdf
from modalmotion.formats.parser_child import landlock_version
from modalmotion.formats.parser_process import ParserLostError, ParserProcess, parser_of_thread

# A parser that knows hostile tasks too, which it imports before it is confined.
PROGRAM = f"""
import sys
sys.path.insert(0, {str(Path(hostile_parsers.__file__).parent)!r})
import hostile_parsers
from modalmotion.formats import parser_child
parser_child._TASKS.update(hostile_parsers.TASKS)
sys.exit(parser_child.main())
"""


def started(program: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )


@pytest.fixture
def parser(monkeypatch: pytest.MonkeyPatch) -> Iterator[ParserProcess]:
    monkeypatch.setattr(parser_process, "_start", lambda: started(PROGRAM))
    with ParserProcess(DEFAULT_LIMITS, 30.0) as made:
        yield made


def tell(parser: ParserProcess, path: str = "/etc/passwd") -> dict[str, object]:
    return parser.parse("tell", path.encode()).info


def pid_of(parser: ParserProcess) -> int:
    pid = tell(parser)["pid"]
    assert isinstance(pid, int)
    return pid


def is_gone(pid: int) -> bool:
    end = time.monotonic() + 20
    while time.monotonic() < end:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    return False


def test_it_parses_as_one_here_does(parser: ParserProcess) -> None:
    data = write_vtkhdf(sequence())
    here = ParserHere(DEFAULT_LIMITS).parse("hdf5", data)
    there = parser.parse("hdf5", data)
    assert (there.arrays["vertices"] == here.arrays["vertices"]).all()
    with pytest.raises(MalformedFileError):
        parser.parse("hdf5", data[:1000])
    assert parser.parse("hdf5", data).info == there.info


@pytest.mark.skipif(not landlock_version(), reason="this system has no Landlock")
def test_it_sees_no_file_and_none_of_its_parents(parser: ParserProcess, tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("of somebody")
    seen = tell(parser, str(tmp_path / "secret"))
    assert seen["text"] == "PermissionError"
    assert not seen["traced"]
    # Standard ones, copies of the two pipes, and the list itself.
    assert isinstance(seen["files"], int)
    assert seen["files"] <= 6


@pytest.mark.skipif(not landlock_version(), reason="this system has no Landlock")
def test_one_that_cannot_be_confined_reads_no_file(monkeypatch: pytest.MonkeyPatch) -> None:
    program = """
import sys
from modalmotion.formats import parser_child
parser_child.confine = lambda: False
sys.exit(parser_child.main())
"""
    monkeypatch.setattr(parser_process, "_start", lambda: started(program))
    with ParserProcess(DEFAULT_LIMITS, 30.0) as parser, pytest.raises(ParserLostError):
        parser.parse("hdf5", write_vtkhdf(sequence()))


def test_one_lives_until_it_is_closed(parser: ParserProcess) -> None:
    first = pid_of(parser)
    assert pid_of(parser) == first
    parser.close()
    assert is_gone(first)
    assert pid_of(parser) not in (first, os.getpid())
    parser.close()
    parser.close()


def test_its_end_does_not_wait_for_what_it_has_forked(parser: ParserProcess) -> None:
    program = """
import os, time
if not os.fork():
    os.write(1, b".")
    time.sleep(10)
    os._exit(0)
time.sleep(10)
"""
    parser._child = child = started(program)
    assert child.stdout is not None
    assert child.stdout.read(1) == b"."
    start = time.monotonic()
    parser.close()
    assert time.monotonic() - start < 5
    assert is_gone(child.pid)


@pytest.mark.parametrize("how", [signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS])
def test_a_file_that_ends_its_parser_is_damaged(parser: ParserProcess, how: signal.Signals) -> None:
    with pytest.raises(MalformedFileError, match="crashed"):
        parser.parse("end", b"%d" % how)
    assert pid_of(parser)


def test_an_answer_that_is_not_one_is_a_damaged_file(parser: ParserProcess) -> None:
    with pytest.raises(MalformedFileError, match="crashed"):
        parser.parse("lie", b"")
    assert pid_of(parser)


def test_a_parser_that_is_killed_says_nothing_of_its_file(parser: ParserProcess) -> None:
    with pytest.raises(ParserLostError, match="from outside"):
        parser.parse("end", b"%d" % signal.SIGKILL)
    # But for one that takes too long, which this end kills.
    with ParserProcess(DEFAULT_LIMITS, 2.0) as hasty, pytest.raises(LimitError, match="2 s"):
        hasty.parse("spin", b"60")


def test_it_ends_with_the_process_that_began_it(tmp_path: Path) -> None:
    program = f"""
import os, signal
from modalmotion.formats import DEFAULT_LIMITS, ParserProcess
parser = ParserProcess(DEFAULT_LIMITS)
try:
    parser.parse("hdf5", b"")
except Exception:
    pass
open({str(tmp_path / "pid")!r}, "w").write(str(parser._child.pid))
os.kill(os.getpid(), signal.SIGKILL)
"""
    subprocess.run([sys.executable, "-c", program], check=False, timeout=120)
    assert is_gone(int((tmp_path / "pid").read_text()))


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


@pytest.mark.parametrize("what", ["process", "thread"])
def test_one_that_cannot_be_started_is_no_fault_of_its_file(
    monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    def refused(*_: object, **__: object) -> None:
        if what == "process":
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        raise RuntimeError("can't start new thread")

    image = write_vtkhdf(sequence())
    with ParserProcess(DEFAULT_LIMITS, 30.0) as parser:
        with monkeypatch.context() as patch:
            of = "subprocess.Popen" if what == "process" else "threading.Thread.start"
            patch.setattr(of, refused)
            with pytest.raises(StoreError, match="could not be started") as caught:
                parser.parse("hdf5", image)
        assert "try again" in caught.value.remedy
        # When there are some again it reads the file.
        assert parser.parse("hdf5", image).arrays["vertices"].any()
