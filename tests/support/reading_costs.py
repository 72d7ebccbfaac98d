"""Reads files and says what each cost the processor; started by a test, for VTK may crash it."""

from __future__ import annotations

import sys
import time
from importlib.util import find_spec
from pathlib import Path

from modalmotion.errors import InputError, MissingExtraError
from modalmotion.formats import DEFAULT_LIMITS, ParserHere, read_sequence
from modalmotion.formats.parser.registry import parser_of


def main(*paths: str) -> int:
    # Imported before the clock runs, as a worker has.
    for task in ("hdf5", *(("vtk", "vtp") if find_spec("vtkmodules") else ())):
        parser_of(task)
    for path in paths:
        data = Path(path).read_bytes()
        started = time.process_time()
        try:
            read_sequence(data, parser=ParserHere(DEFAULT_LIMITS))
            outcome = "read"
        except InputError as error:
            outcome = "refused" if error.message and error.remedy else "no remedy"
        except MissingExtraError:
            outcome = "refused"
        seconds = time.process_time() - started
        sys.stdout.write(f"{Path(path).name}\t{outcome}\t{seconds:.3f}\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
