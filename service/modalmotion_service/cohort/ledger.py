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
    key : str
        Of its signature.
    kind : str
        See `Signed`.
    springs : bool
        Whether it has the spring modes of its mesh because others of the cohort do.
    """

    path: str
    stamp: str
    settings: str
    sequence_id: str
    rms_error: float
    weighted_rms_error: float
    unit: str | None
    key: str = ""
    kind: str = ""
    springs: bool = False


class Ledger:
    """Lines are appended; a line that a crash cut short is done again.

    A line is written once its signature is stored, and need not be durable: results are
    immutable, so what is lost from here costs only the time to make it again. What was noted is
    not kept in memory: `add` gives the place of each line, and `at` reads it.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME
        done = {(one.path, one.springs): one for one in self._read()}
        # Without cut or outdated lines, so that it does not grow from run to run.
        write_atomic(self._path, "".join(map(_line, done.values())).encode())
        self._earlier = {which: (one.stamp, one.settings) for which, one in done.items()}
        self._places: dict[tuple[str, bool], int] = {}
        place = 0
        for which, one in done.items():
            self._places[which] = place
            place += len(_line(one).encode())

    def find(self, path: object, stamp: str, settings: str, *, springs: bool = False) -> int | None:
        """Give the place of an earlier run's line, if the file and the settings are the same."""
        which = str(path), springs
        is_same = self._earlier.get(which) == (stamp, settings)
        return self._places[which] if is_same else None

    def forget_earlier(self) -> None:
        """Free what `find` needs, but for spring modes, which are looked for last."""
        for named in (self._earlier, self._places):
            for which in [which for which in named if not which[1]]:
                del named[which]

    def at(self, place: int) -> Done:
        """Read the line at a place."""
        with self._path.open("rb") as file:
            file.seek(place)
            return Done(**json.loads(file.readline()))

    def add(self, *several: Done) -> list[int]:
        """Note that files are done; give the places of their lines."""
        places = []
        with self._path.open("ab") as file:
            for done in several:
                places.append(file.tell())
                file.write(_line(done).encode())
        return places

    def _read(self) -> Iterator[Done]:
        if not self._path.exists():
            return
        with self._path.open() as file:
            for line in file:
                with contextlib.suppress(ValueError, TypeError):
                    yield Done(**json.loads(line))


def _line(done: Done) -> str:
    return json.dumps(asdict(done)) + "\n"


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


def with_landmarks(stamp: str, landmarks: Mapping[str, object]) -> str:
    """Give the stamp of a file from elsewhere with what tracking starts from; empty stays so."""
    if not landmarks or not stamp:
        return stamp
    stated = (stamp, sorted(landmarks.items()))
    return hashlib.sha256(repr(stated).encode()).hexdigest()[:16]
