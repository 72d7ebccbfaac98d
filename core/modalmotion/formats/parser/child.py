"""What runs in a parser's process: a request, the parser, the answer."""

from __future__ import annotations

import contextlib
import json
import os
import sys
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, LimitError
from modalmotion.formats.parser.confinement import confine, end_with
from modalmotion.formats.parser.registry import limits_on, parser_of
from modalmotion.limits import ReadLimits

# For the libraries' own needs, besides the arrays that the limits allow.
_SPARE_BYTES: Final = 1 << 28


def main() -> int:
    """Answer requests until their stream ends."""
    source = os.fdopen(os.dup(0), "rb")
    sink = os.fdopen(os.dup(1), "wb")
    # Libraries that print must not print into the answers.
    with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - a device, not a path
        os.dup2(nowhere.fileno(), 1)
    end_with(os.getppid())
    # From here on it has two pipes, Python and its packages.
    confine()
    while answer_next(source, sink):
        pass
    return 0


def answer_next(source: IO[bytes], sink: IO[bytes]) -> bool:
    """Parse the next file; False where there is none."""
    length = int.from_bytes(source.read(8), "little")
    if not length:
        return False
    request = json.loads(source.read(length))
    data = source.read(request["bytes"])
    limits = limits_on(request["task"], len(data), ReadLimits(**request["limits"]))
    try:
        parse = parser_of(request["task"])
        _limit_this_process(limits, len(data), request["seconds"])
        info, arrays = parse(data, limits)
    except InputError as error:
        _answer(sink, _state(error), {}, {})
    except MemoryError:
        _answer(sink, _state(_too_large(limits)), {}, {})
    else:
        _answer(sink, None, info, arrays)
    return True


def _answer(
    sink: IO[bytes],
    error: dict[str, Any] | None,
    info: dict[str, Any],
    arrays: dict[str, NDArray[Any]],
) -> None:
    # Axes in the order in which they are in memory: a copy of the samples would double it.
    axes = {name: np.argsort(array.strides)[::-1].tolist() for name, array in arrays.items()}
    plain = {
        name: np.ascontiguousarray(array.transpose(axes[name])) for name, array in arrays.items()
    }
    listed = [(name, array.dtype.str, array.shape, axes[name]) for name, array in plain.items()]
    header = json.dumps({"error": error, "info": info, "arrays": listed}).encode()
    sink.write(len(header).to_bytes(8, "little"))
    sink.write(header)
    for array in plain.values():
        sink.write(array.data)
    sink.flush()


def _state(error: InputError) -> dict[str, Any]:
    return {
        "kind": type(error).__name__,
        "message": error.message,
        "remedy": error.remedy,
        "frame": error.frame,
        "vertex": error.vertex,
        "limit": error.limit,
        "details": error.details,
    }


def _too_large(limits: ReadLimits) -> LimitError:
    return LimitError(
        "Reading the file takes more memory than is allowed.",
        remedy="Send fewer frames or a coarser mesh, or have the limit raised.",
        limit="decompressed_bytes",
        details={"most": limits.decompressed_bytes},
    )


def _limit_this_process(limits: ReadLimits, n_bytes: int, seconds: float | None) -> None:
    try:
        import resource
    except ImportError:
        # Not on every system; the caller's clock still ends this process.
        return
    # No core dump: it would contain the content of the file.
    _lower(resource.RLIMIT_CORE, 0)
    if seconds is not None:
        used = resource.getrusage(resource.RUSAGE_SELF)
        _lower(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime + 2 * seconds) + 1)
    declared = min(limits.decompressed_bytes, limits.unfolded_bytes)
    most = 3 * declared + 4 * n_bytes + _SPARE_BYTES
    if (now := _address_space()) is not None:
        _lower(resource.RLIMIT_AS, now + most)


def _lower(which: int, value: int) -> None:
    import resource

    _, hard = resource.getrlimit(which)
    # Refused where an outer limit is lower, or where the system knows no such number.
    with contextlib.suppress(ValueError, OSError, OverflowError):
        resource.setrlimit(which, (value, hard))


def _address_space() -> int | None:
    try:
        with open("/proc/self/statm", "rb") as statm:  # noqa: PTH123 - no file on a disk
            return int(statm.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return None


if __name__ == "__main__":
    sys.exit(main())
