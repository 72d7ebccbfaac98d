"""A machine on which others are at work."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def busy_processes(n: int) -> Iterator[None]:
    """Keep the machine busy, without a spare moment.

    They come second: among twelve equals a test of thousands of turns lasts half an hour.
    """
    code = "import os; os.nice(10)\nwhile True: pass"
    busy = [subprocess.Popen([sys.executable, "-c", code]) for _ in range(n)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()
