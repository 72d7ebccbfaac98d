"""Which files of a cohort are done: one line each, in a file beside the results."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType

from modalmotion.store import write_atomic

NAME = "cohort.jsonl"


@dataclass(frozen=True)
class Done:
    """A file whose signature is stored.

    Parameters
    ----------
    path : str
    stamp : str
        Of the file as it was: see `stamp_of`.
    settings : str
        Digest of all options and parameters of the signature.
    sequence_id : str
    rms_error, weighted_rms_error : float
    unit : str or None
    """

    path: str
    stamp: str
    settings: str
    sequence_id: str
    rms_error: float
    weighted_rms_error: float
    unit: str | None


class Ledger:
    """Lines are appended; a line that a crash cut short is done again.

    A line is written once its signature is stored, and need not be durable: results are
    immutable, so what is lost from here costs only the time to make it again.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        self._done = {done.path: done for done in self._read()}
        # Without cut or outdated lines, so that it does not grow from run to run.
        lines = [json.dumps(asdict(done)) + "\n" for done in self._done.values()]
        write_atomic(self._path, "".join(lines).encode())

    def find(self, path: Path, stamp: str, settings: str) -> Done | None:
        """Give the entry of a file, if the file and the settings are still the same."""
        done = self._done.get(str(path))
        return done if done and (done.stamp, done.settings) == (stamp, settings) else None

    def add(self, *several: Done) -> None:
        """Note that files are done."""
        with self._path.open("a") as file:
            for done in several:
                file.write(json.dumps(asdict(done)) + "\n")
        self._done.update({done.path: done for done in several})

    def _read(self) -> Iterator[Done]:
        if not self._path.exists():
            return
        for line in self._path.read_text().splitlines():
            with contextlib.suppress(ValueError, TypeError):
                yield Done(**json.loads(line))


def stamp_of(path: Path, landmarks: Mapping[str, object] = MappingProxyType({})) -> str:
    """Digest of names, sizes and times of change of a file, or of those in a folder or pattern.

    It detects a replaced file without reading it, and other landmarks, which tracking starts from.
    """
    if path.is_dir():
        files = sorted(path.iterdir())
    else:
        files = [path] if path.exists() else sorted(path.parent.glob(path.name))
    statuses = [(file.name, file.stat()) for file in files]
    seen = [(name, status.st_size, status.st_mtime_ns) for name, status in statuses]
    stated = (seen, sorted(landmarks.items())) if landmarks else seen
    return hashlib.sha256(repr(stated).encode()).hexdigest()[:16]
