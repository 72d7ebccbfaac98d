"""Reads files and says what each cost the processor; started by a test, for HDF5 may crash it."""

from __future__ import annotations

import sys
import time
from pathlib import Path

from modalmotion.errors import InputError
from modalmotion.formats import DEFAULT_LIMITS, ParserHere, read_sequence
from modalmotion.formats.parser_child import parser_of


def main(*paths: str) -> int:
    # Imported before the clock runs, as a worker has.
    parser_of("hdf5")
    for path in paths:
        data = Path(path).read_bytes()
        started = time.process_time()
        try:
            read_sequence(data, parser=ParserHere(DEFAULT_LIMITS))
            outcome = "read"
        except InputError as error:
            outcome = "refused" if error.message and error.remedy else "no remedy"
        seconds = time.process_time() - started
        sys.stdout.write(f"{Path(path).name}\t{outcome}\t{seconds:.3f}\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
