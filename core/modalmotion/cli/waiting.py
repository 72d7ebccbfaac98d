"""Progress of a command on stderr, and its times."""

from __future__ import annotations

import os
import sys
import threading
import time
from pathlib import Path
from typing import Final, Self

import click

from modalmotion.progress import Stopwatch

# A shorter stage is not named while it lasts.
_PATIENCE_SECONDS: Final = 1.0


class Waiting:
    """Times the stages of a command, and names those that last on stderr.

    On a terminal the line shows elapsed seconds and the progress of the stage; elsewhere each stage
    is named once.

    Parameters
    ----------
    source : Path
        What is read: frames that are files of their own have a bar of their own.
    """

    def __init__(self, source: Path) -> None:
        self.watch = Stopwatch(report=lambda _share, name: self._note(name))
        has_bar = source.suffix.lower() == ".zip" or not source.is_file()
        self._shown = {"read"} if has_bar else set()
        self._began = time.perf_counter()
        self._before = _seconds_of_this_command()
        self._stage: tuple[str, float] | None = None
        self._over = threading.Event()
        self._teller = threading.Thread(target=self._tell, daemon=True)

    def __enter__(self) -> Self:
        self._teller.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._teller.join()

    def milliseconds(self) -> dict[str, float]:
        """Give the time of each stage; `start` and `other` make it all that was waited for."""
        stages = dict(self.watch.milliseconds)
        since = 1e3 * (time.perf_counter() - self._began)
        start = {"start": 1e3 * self._before} if self._before else {}
        return {**start, **stages, "other": max(0.0, since - sum(stages.values()))}

    def _note(self, name: str) -> None:
        self._stage = (name, time.perf_counter()) if name else None

    def _tell(self) -> None:
        is_terminal, width = sys.stderr.isatty(), 0
        while not self._over.wait(_PATIENCE_SECONDS):
            if (stage := self._stage) is None or stage[0] in self._shown:
                continue
            name, since = stage
            seconds = time.perf_counter() - since
            if is_terminal:
                done = self.watch.of_stage
                line = f"{name} {seconds:.0f} s" + (f", {done:.0%}" if done else "")
                click.echo(f"\r{line:<{width}}", nl=False, err=True)
                width = max(width, len(line))
            elif seconds >= _PATIENCE_SECONDS:
                click.echo(f"{name} ...", err=True)
                self._shown.add(name)
        if width:
            click.echo(f"\r{'':<{width}}\r", nl=False, err=True)


def _seconds_of_this_command() -> float:
    """Seconds since this process began, with its imports; 0 where it is not a command of ours."""
    program = Path(sys.argv[0])
    if program.stem != "modalmotion" and program.parent.name != "modalmotion":
        return 0.0
    try:
        # As proc(5) has it: the 22nd field, in ticks since the machine began.
        ticks = Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]
        uptime = float(Path("/proc/uptime").read_text().split()[0])
    except (OSError, ValueError, IndexError):
        return 0.0
    return max(0.0, uptime - int(ticks) / os.sysconf("SC_CLK_TCK"))
