"""Reads files in a process that may take no more than some memory; started by a test."""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

from modalmotion.errors import InputError
from modalmotion.formats import DEFAULT_LIMITS, ParserProcess, read_sequence


def main(megabytes: str, *paths: str) -> int:
    used = int(Path("/proc/self/statm").read_bytes().split()[0]) * resource.getpagesize()
    most = used + int(megabytes) * 1_000_000
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    with ParserProcess(DEFAULT_LIMITS) as parser:
        for path in paths:
            data = Path(path).read_bytes()
            started = time.perf_counter()
            try:
                read = read_sequence(data, parser=parser)
            except InputError as error:
                outcome = type(error).__name__ if error.remedy else "no remedy"
            except MemoryError:
                outcome = "too much memory"
            else:
                outcome = repr(read.sequence)
            seconds = time.perf_counter() - started
            sys.stdout.write(f"{Path(path).name}\t{outcome}\t{seconds:.3f}\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
