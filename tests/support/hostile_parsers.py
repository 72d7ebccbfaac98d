"""Parsers that a file has taken over."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np

from modalmotion.formats.result import Parsed
from modalmotion.limits import ReadLimits


def tell(data: bytes, _limits: ReadLimits) -> Parsed:
    """What a process sees of itself: number, parent, and whether it may read a file."""
    try:
        text = Path(data.decode()).read_text()
    except OSError as error:
        text = type(error).__name__
    parent = f"/proc/{os.getppid()}/mem"
    try:
        with open(parent, "rb"):  # noqa: PTH123 - no file on a disk
            traced = True
    except OSError:
        traced = False
    files = len(list(Path("/proc/self/fd").iterdir()))
    info = {"pid": os.getpid(), "text": text, "traced": traced, "files": files}
    return info, {"x": np.arange(3.0)}


def end(data: bytes, _limits: ReadLimits) -> Parsed:
    """End by a signal."""
    os.kill(os.getpid(), int(data))
    time.sleep(60)
    return {}, {}


def spin(data: bytes, _limits: ReadLimits) -> Parsed:
    """Take so many seconds of processor time."""
    while time.process_time() < float(data):
        pass
    return {}, {}


def lie(_data: bytes, _limits: ReadLimits) -> Parsed:
    """Answer what is not an answer."""
    import sys

    frame = sys._getframe()
    while "sink" not in frame.f_locals:
        assert frame.f_back is not None
        frame = frame.f_back
    sink = frame.f_locals["sink"]
    sink.write((40).to_bytes(8, "little") + b'{"error": {"kind": "OSError"}, "x": [[]]}'[:40])
    sink.flush()
    os.kill(os.getpid(), signal.SIGSEGV)
    return {}, {}


TASKS = {name: f"hostile_parsers:{name}" for name in ("tell", "end", "spin", "lie")}
