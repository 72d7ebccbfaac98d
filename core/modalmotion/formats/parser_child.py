"""What runs in a parser's process: its confinement, a request, the parser, the answer.

The libraries that parse HDF5 and images can be made to run anything by some file. What runs in a
process confined by Landlock, where Linux has it, reads Python and its packages, writes nothing,
opens no connection and signals nobody. No right is needed for it, and nothing gives it back
(Linux 5.13; connections from 6.7, signals from 6.12).
"""

import contextlib
import ctypes
import json
import os
import signal
import struct
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from modalmotion.errors import InputError, LimitError
from modalmotion.formats.result import Answer, Parsed
from modalmotion.limits import ReadLimits
from modalmotion.representation import Array

# Each imports a library that damaged files can crash, and that is slow to import.
_TASKS: Final = {
    "hdf5": "modalmotion.formats.vtkhdf:parse_hdf5",
    "clouds": "modalmotion.formats.vtkhdf:parse_clouds",
    "datasets": "modalmotion.formats.vtkhdf:parse_datasets",
    "mat": "modalmotion.formats.named_arrays:parse_matlab",
    "dicom": "modalmotion.formats.volumes.dicom:parse_dicom",
    "study": "modalmotion.formats.volumes.dicom:parse_study",
    "metaimage": "modalmotion.formats.volumes.one_file:parse_metaimage",
    "nifti": "modalmotion.formats.volumes.one_file:parse_nifti",
    "nrrd": "modalmotion.formats.volumes.one_file:parse_nrrd",
}

UNCONFINED: Final = 77
"""How a parser ends that could not be confined where the system can."""


@dataclass(frozen=True)
class ParserHere:
    """Runs parsers in this process.

    For processes that may be lost and are limited from outside: it saves the half second that a
    process of its own takes to start.

    Parameters
    ----------
    limits : ReadLimits
    """

    limits: ReadLimits

    def parse(self, task: str, data: bytes) -> Answer:
        """Parse a file.

        Raises
        ------
        InputError
            What the parser raised.
        """
        return Answer(*parser_of(task)(data, _limits_on(task, len(data), self.limits)))


def parser_of(task: str) -> Callable[[bytes, ReadLimits], Parsed]:
    """Find a parser by its name."""
    module, _, function = _TASKS[task].partition(":")
    parse: Callable[[bytes, ReadLimits], Parsed] = getattr(import_module(module), function)
    return parse


def _limits_on(task: str, n_bytes: int, limits: ReadLimits) -> ReadLimits:
    # Images may be of one colour: packed to nothing, and not in proportion to their files.
    return limits if ".volumes." in _TASKS[task] else limits.of_file(n_bytes)


# The same numbers on every architecture.
_CREATE_RULESET: Final = 444
_ADD_RULE: Final = 445
_RESTRICT_SELF: Final = 446
_VERSION: Final = 1
_PATH_BENEATH: Final = 1
_PARENT_DEATH_SIGNAL: Final = 1
_NO_NEW_PRIVILEGES: Final = 38

# Execute, read a file, read a folder; of a file the first two.
_READ: Final = 0b1101
_READ_FILE: Final = 0b0101
# Rights over files that each version of the interface knows.
_RIGHTS: Final = {1: 13, 2: 14, 3: 15, 4: 15}
_ALL_RIGHTS: Final = 16


def landlock_version() -> int:
    """Version of Landlock's interface in this system; 0 where there is none."""
    if sys.platform != "linux":
        return 0
    return max(0, int(_libc().syscall(_CREATE_RULESET, None, 0, _VERSION)))


def confine() -> bool:
    """Leave this process nothing but Python and its packages, to read; False where that fails."""
    version = landlock_version()
    if not version:
        return False
    libc = _libc()
    handled = (1 << _RIGHTS.get(version, _ALL_RIGHTS)) - 1
    # Files; binding and connecting; sockets without a name in the file system, and signals.
    rules = struct.pack("=3Q", handled, 0b11 if version >= 4 else 0, 0b11 if version >= 6 else 0)
    ruleset = libc.syscall(
        _CREATE_RULESET, rules, 8 if version < 4 else 16 if version < 6 else 24, 0
    )
    if ruleset < 0:
        return False
    try:
        for path in _readable():
            _allow(libc, ruleset, path)
        if libc.prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0):
            return False
        return bool(libc.syscall(_RESTRICT_SELF, ruleset, 0) == 0)
    finally:
        os.close(ruleset)


def end_with(parent: int) -> None:
    """Have this process killed when its parent ends, whatever it is doing (Linux).

    Parameters
    ----------
    parent : int
        Its number; where it has ended already, so does this process.
    """
    if sys.platform == "linux":
        _libc().prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)


def _readable() -> Iterator[Path]:
    # The package itself.
    yield Path(__file__).parents[1]
    for prefix in {sys.prefix, sys.base_prefix, sys.exec_prefix}:
        yield from (Path(prefix) / name for name in ("lib", "lib64", "bin"))
    # With its own size, which the limit on memory starts from.
    files = ("/proc/self", "/etc/ld.so.cache", "/dev/null", "/dev/urandom")
    yield from map(Path, ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", *files))


def _allow(libc: ctypes.CDLL, ruleset: int, path: Path) -> None:
    with contextlib.suppress(OSError):
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
        rule = struct.pack("=Qi", _READ if path.is_dir() else _READ_FILE, place)
        libc.syscall(_ADD_RULE, ruleset, _PATH_BENEATH, rule, 0)
        os.close(place)


def _libc() -> ctypes.CDLL:
    libc = ctypes.CDLL(None, use_errno=True)
    libc.syscall.restype = ctypes.c_long
    return libc


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
    if not confine() and landlock_version():
        return UNCONFINED
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
    limits = _limits_on(request["task"], len(data), ReadLimits(**request["limits"]))
    error, info, arrays = None, dict[str, Any](), dict[str, Array]()
    try:
        parse = parser_of(request["task"])
        _limit_this_process(limits, len(data), request["seconds"])
        info, arrays = parse(data, limits)
    except InputError as raised:
        error = _state(raised)
    except MemoryError:
        too_large = LimitError(
            "Reading the file takes more memory than is allowed.",
            remedy="Send fewer frames or a coarser mesh, or have the limit raised.",
            limit="decompressed_bytes",
            details={"most": limits.decompressed_bytes},
        )
        error = _state(too_large)
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
    return True


def _state(error: InputError) -> dict[str, Any]:
    names = ("message", "remedy", "frame", "vertex", "limit", "details")
    return {"kind": type(error).__name__, **{name: getattr(error, name) for name in names}}


def _limit_this_process(limits: ReadLimits, n_bytes: int, seconds: float) -> None:
    try:
        import resource
    except ImportError:
        # Not on every system; the caller's clock still ends this process.
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    most = {
        # No core dump: it would contain the content of the file.
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_CPU: int(used.ru_utime + used.ru_stime + 2 * seconds) + 1,
    }
    # Where the system states this process's size.
    with contextlib.suppress(OSError, ValueError):
        now = int(Path("/proc/self/statm").read_bytes().split()[0]) * os.sysconf("SC_PAGE_SIZE")
        declared = min(limits.decompressed_bytes, limits.unfolded_bytes)
        most[resource.RLIMIT_AS] = now + 3 * declared + 4 * n_bytes + _SPARE_BYTES
    for which, value in most.items():
        # Refused where an outer limit is lower, or where the system knows no such number.
        with contextlib.suppress(ValueError, OSError, OverflowError):
            resource.setrlimit(which, (value, resource.getrlimit(which)[1]))


if __name__ == "__main__":
    sys.exit(main())
