"""Tests in several processes that are forked when all is collected.

Files are so imported once. With pytest-xdist each process collects all, a tenth of its time.
"""

from __future__ import annotations

import atexit
import os
import signal
from itertools import chain, pairwise
from multiprocessing.connection import Connection, Pipe, wait
from pathlib import Path
from typing import Any

import pytest
from _pytest._io import TerminalWriter

# Of the number of a group, as processes read it from a pipe.
_BYTES = 2


def groups_of(items: list[pytest.Item]) -> list[list[pytest.Item]]:
    """Keep together the tests of a file, and files that share a fixture that takes seconds."""
    together: dict[str, str] = {}
    for item in items:
        fixtures = getattr(item, "fixturenames", ())
        if "dask_cluster" in fixtures or "workers of a scheduler" in item.nodeid:
            together[_file(item)] = "dask_cluster"
        elif "trained" in fixtures:
            together[_file(item)] = "trained"
    groups: dict[str, list[pytest.Item]] = {}
    for item in items:
        groups.setdefault(together.get(_file(item), _file(item)), []).append(item)
    return [*groups.values()]


def _file(item: pytest.Item) -> str:
    return item.nodeid.partition("::")[0]


def run(session: pytest.Session, n_processes: int) -> None:
    """Run the tests of a session in forks of this process; pass on what they report."""
    groups, hook = groups_of(session.items), session.config.hook
    if (threads := len([*Path("/proc/self/task").iterdir()])) > 1:
        # A fork takes along one of them, and whatever locks the others hold.
        raise pytest.UsageError(
            f"{threads} threads: set OMP_NUM_THREADS and OPENBLAS_NUM_THREADS to 1"
        )
    # Whoever is free reads the number of the next group.
    numbers, end = os.pipe()
    os.write(end, b"".join(number.to_bytes(_BYTES, "big") for number in range(len(groups))))
    os.close(end)
    running: dict[Connection, tuple[int, list[Any]]] = {}
    n_left = len(session.items)
    try:
        for _ in range(n_processes):
            ours, theirs = Pipe(duplex=False)
            if not (pid := os.fork()):
                _work(session, groups, numbers, theirs)
            theirs.close()
            running[ours] = (pid, [])
        while running:
            for place in wait([*running]):
                assert isinstance(place, Connection)
                pid, under_way = running[place]
                try:
                    name, data = place.recv()
                except EOFError:
                    del running[place]
                    place.close()
                    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                    if status or under_way:
                        _report_an_end(hook, status, under_way)
                    continue
                if name == "start":
                    under_way[:] = data
                elif name == "finish":
                    under_way.clear()
                    n_left -= 1
                    hook.pytest_runtest_logfinish(nodeid=data[0], location=data[1])
                else:
                    report = hook.pytest_report_from_serializable(config=session.config, data=data)
                    hook.pytest_runtest_logreport(report=report)
                if session.shouldfail:
                    raise session.Failed(session.shouldfail)
    finally:
        os.close(numbers)
        for place, (pid, _) in running.items():
            os.kill(pid, signal.SIGTERM)
            os.waitpid(pid, 0)
            place.close()
    if n_left and not session.testsfailed:
        raise session.Failed(f"{n_left} tests were not run")


def _report_an_end(hook: Any, status: int, under_way: list[Any]) -> None:
    nodeid, location = under_way or ("a process of the test run", ("", None, ""))
    said = f"the process of the test ended with {status}"
    hook.pytest_runtest_logreport(
        report=pytest.TestReport(nodeid, location, {}, "failed", said, "call")
    )


class _Sender:
    """In place of the reporter on the terminal, in a process that has none."""

    def __init__(self, config: pytest.Config, place: Connection) -> None:
        self._config, self._place = config, place
        # Where stacks of what hangs are written to.
        self._tw = TerminalWriter()

    def pytest_runtest_logstart(self, nodeid: str, location: tuple[Any, ...]) -> None:
        self._place.send(("start", (nodeid, location)))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        data = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        self._place.send(("report", data))

    def pytest_runtest_logfinish(self, nodeid: str, location: tuple[Any, ...]) -> None:
        self._place.send(("finish", (nodeid, location)))


def _work(
    session: pytest.Session, groups: list[list[pytest.Item]], numbers: int, place: Connection
) -> None:
    """Run group after group, and end this process."""
    status = 1
    try:
        plugins = session.config.pluginmanager
        # Files of its own for what tests print.
        capture: Any = plugins.getplugin("capturemanager")
        capture.stop_global_capturing()
        capture.start_global_capturing()
        plugins.unregister(name="terminalreporter")
        plugins.register(_Sender(session.config, place), "terminalreporter")
        # `pairwise` looks one ahead, as fixtures of more than one test need it.
        taken = iter(lambda: os.read(numbers, _BYTES), b"")
        items = (item for number in taken for item in groups[int.from_bytes(number, "big")])
        for item, after in pairwise(chain(items, [None])):
            assert item is not None
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)
        status = 0
    finally:
        atexit._run_exitfuncs()
        place.close()
        os._exit(status)
