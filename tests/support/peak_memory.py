"""Reads each file in a process of its own and prints how it ended and its peak; run by a test."""

from __future__ import annotations

import json
import os
import resource
import sys
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

from modalmotion.errors import InputError
from modalmotion.formats import DEFAULT_LIMITS, ParserHere, read_sequence
from modalmotion.formats.parser_child import answer_next, parser_of
from modalmotion.formats.volumes.reading import kind_of_image

# With what each imports in turn, which is no part of a file's memory.
TASKS = {
    "nifti": ["nibabel"],
    "nrrd": ["nrrd"],
    "metaimage": [],
    "dicom": ["pydicom.pixels"],
    "hdf5": ["h5py", "encodings.ascii"],
}


def parsed(task: str, data: bytes) -> str:
    """Do what a parser's process does with a file: parse it, and send the answer away."""
    request = {"task": task, "bytes": len(data), "limits": asdict(DEFAULT_LIMITS), "seconds": 3600}
    header = json.dumps(request).encode()
    pieces = iter((len(header).to_bytes(8, "little"), header, data))
    source = SimpleNamespace(read=lambda _: next(pieces))
    answers: list[bytes] = []
    sink = SimpleNamespace(write=answers.append, flush=int)
    answer_next(source, sink)  # type: ignore[arg-type]
    error = json.loads(answers[1])["error"]
    return "read" if error is None else str(error["kind"])


def outcome(data: bytes) -> str:
    """Read a file as its reader does."""
    task = kind_of_image(data)
    try:
        if task is not None:
            return parsed(task, data)
        read_sequence(data, parser=ParserHere(DEFAULT_LIMITS))
    except InputError as error:
        return type(error).__name__ if error.remedy else "no remedy"
    return "read"


def peak_of(path: Path) -> tuple[str, int]:
    """Read it in a fork; how that ended, and the bytes by which the fork grew."""
    reading, writing = os.pipe()
    if not (pid := os.fork()):
        data = path.read_bytes()
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        said = outcome(data)
        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        os.write(writing, f"{said}\t{grown}".encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as answer:
        words = answer.read().split("\t")
    os.waitpid(pid, 0)
    return words[0], int(words[1])


def main(*paths: str) -> int:
    for task, libraries in TASKS.items():
        parser_of(task)
        for library in libraries:
            import_module(library)
    for path in paths:
        said, grown = peak_of(Path(path))
        sys.stdout.write(f"{Path(path).name}\t{said}\t{grown}\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
