"""Layout of the folder of a store, and records of sequences.

::

    templates/ab/<id>.h5                            kept until the folder is deleted
    images/ab/<id>.json                             record: shape, spacing, times, when
    images/ab/<id>.h5                               the samples
    spool/  access/  owners/                        a service's: not the store's
    lock                                            held by the process that has it open
    index.sqlite                                    index, jobs, idempotency keys
    sequences/ab/<id>.json                          record: subject, label, when
    sequences/ab/<id>.h5                            the vertices, if uploads are kept
    sequences/ab/<id>.deleted                       a deletion that is under way
    signatures/ab/<id>-<key>.h5
    signatures/ab/<id>-<key>.json                   a text made of it, which may be missing
    classifications/ab/<id>-<model id>-<key>.h5
    tracks/ab/<id>-<first digits of the id>.h5      how the sequence was tracked
    models/<name>/<version>.h5
    models/<name>/<version>.deleted                 stays, so that the number is never used again
    norms/<name>.h5
    deleted/ab/<digest of an id>                    tombstone: sequence, template, images, norm
    backup.json                                     of a backup: its time

`ab` are the first two digits of the id, so that no folder grows too large to list.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

from modalmotion import errors, mesh
from modalmotion.classification.card import NAME_PATTERN, VERSION_PATTERN, ModelReference
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import is_readable, shown
from modalmotion.store.disk import JsonForm, is_temporary

_ID: Final = "[0-9a-f]{64}"
_KEY: Final = "[0-9a-f]{16}"
# Folder and suffix of what lies in shards under an id.
_BY_ID: Final = {
    "records": ("sequences", ".json"),
    "uploads": ("sequences", ".h5"),
    "deletions": ("sequences", ".deleted"),
    "templates": ("templates", ".h5"),
    "image_records": ("images", ".json"),
    "images": ("images", ".h5"),
}
_VERSIONS: Final = {"models": ".h5", "deleted_models": ".deleted"}
# A folder, and an id that begins with its name.
_IN_SHARD: Final = r"(?P<shard>[0-9a-f]{2})/(?P<id>(?P=shard)[0-9a-f]{62})"
_KIND: Final = r"(?P<kind>(?P<has_model>classification)|signature|track)"
_MODEL: Final = rf"models/(?P<name>{NAME_PATTERN})/(?P<version>{VERSION_PATTERN})"
_PATTERNS: Final = {
    place: re.compile(pattern)
    for place, pattern in (
        *((place, rf"{of}/{_IN_SHARD}\{suffix}") for place, (of, suffix) in _BY_ID.items()),
        *((place, rf"{_MODEL}\{suffix}") for place, suffix in _VERSIONS.items()),
        ("results", rf"{_KIND}s/{_IN_SHARD}-(?(has_model)(?P<model>{_ID})-)(?P<key>{_KEY})\.h5"),
        ("rendered", rf"signatures/{_IN_SHARD}-{_KEY}\.json"),
        ("norms", rf"norms/(?P<id>{NAME_PATTERN})\.h5"),
    )
}
"""Paths of the files of a store, by place."""
# A cohort's own list of finished work, and its table.
_COHORT_FILES: Final = ("cohort.jsonl", "cohort.csv")
_INDEX_FILES: Final = ("index.sqlite", "index.sqlite-wal", "index.sqlite-shm")

RENDERED: Final = ".json"
"""Suffix of a text that is kept beside the signature that it was made of."""

ResultKind = Literal["signature", "classification", "track"]


class ResultName(NamedTuple):
    """Name of a result, in the index and as a file.

    Parameters
    ----------
    kind : "signature", "classification" or "track"
    sequence_id : str
    model_id : str
        Of a classification; else empty.
    key : str
        Of the signature's parameters; of a track see `track_name`.
    """

    kind: ResultKind
    sequence_id: str
    model_id: str
    key: str


def track_name(sequence_id: str) -> ResultName:
    """Name of the track that made a sequence: there is one at most, so its key says nothing."""
    return ResultName("track", sequence_id, "", sequence_id[:16])


Scan = dict[str, set[Any]]
"""Names of everything that is in a store, by place; of what has none the paths, as `temporaries`
and `foreign`."""


@dataclass(frozen=True)
class Folder:
    """Paths in the folder of a store."""

    root: Path

    @property
    def lock(self) -> Path:
        """The file that is locked."""
        return self.root / "lock"

    @property
    def index(self) -> Path:
        """The SQLite file."""
        return self.root / _INDEX_FILES[0]

    @property
    def index_files(self) -> tuple[Path, ...]:
        """The SQLite file and what SQLite puts beside it."""
        return tuple(self.root / name for name in _INDEX_FILES)

    @property
    def exists(self) -> bool:
        """Whether there is a store at all."""
        folders = (self.root / name for name in ("sequences", "models"))
        return self.index.is_file() or any(folder.is_dir() for folder in folders)

    def path(self, place: str, name: Any) -> Path:
        """File of a place: of an id, a result's name, a norm's, or a reference to a model."""
        parts: tuple[str, ...]
        if place in _BY_ID:
            folder, suffix = _BY_ID[place]
            parts = (folder, name[:2], f"{name}{suffix}")
        elif place in _VERSIONS:
            parts = ("models", name.name, f"{name.version}{_VERSIONS[place]}")
        elif place == "norms":
            parts = ("norms", f"{name}.h5")
        else:
            ids = (name.sequence_id, name.model_id, name.key)
            parts = (f"{name.kind}s", ids[0][:2], "-".join(filter(None, ids)) + ".h5")
        return self.root.joinpath(*parts)

    def last_version(self, name: str) -> int:
        """Highest version of a model that was ever used, deleted or not; 0 for none."""
        used = self.names("models") + self.names("deleted_models")
        return max((one.version for one in used if one.name == name), default=0)

    def derived(self, sequence_id: str) -> list[Path]:
        """All files of results of a sequence, as they are there."""
        shards = (self.root / name / sequence_id[:2] for name in RESULT_FOLDERS)
        # Not by glob, which passes over a folder that cannot be read.
        paths = (path for shard in shards if shard.is_dir() for path in shard.iterdir())
        return [path for path in paths if path.name.startswith(f"{sequence_id}-")]

    def short(self, path: Path) -> str:
        """Path within the store, which names no folder of the machine."""
        return path.relative_to(self.root).as_posix()

    def scan(self) -> Scan:
        """List everything that is in the store.

        Raises
        ------
        StoreError
            If a folder cannot be read.
        """
        scan: Scan = {place: set() for place in (*_PATTERNS, "temporaries", "foreign")}
        known = (*_INDEX_FILES, "lock", *_OF_THE_SERVICE, *_KEPT_BESIDE, *FOLDERS)
        try:
            scan["foreign"] = {path for path in self.root.iterdir() if path.name not in known}
            for path in (path for name in FOLDERS for path in _files(self.root / name)):
                place, name = self._sorted(path)
                scan[place].add(name)
        except OSError as error:
            raise errors.StoreError(
                f"The folder of the store cannot be read: {error.strerror}.",
                remedy="Check the disk and the read permission of this user.",
            ) from error
        return scan

    def names(self, place: str) -> list[Any]:
        """Names of all files of a place, sorted."""
        paths = _files(self.root / _PATTERNS[place].pattern.partition("/")[0])
        return sorted(name for at, name in map(self._sorted, paths) if at == place)

    def _sorted(self, path: Path) -> tuple[str, Any]:
        """Place of a file, and its name there; the path where it has none."""
        short = self.short(path)
        for place, pattern in _PATTERNS.items():
            if (match := pattern.fullmatch(short)) is not None:
                return place, _name(match)
        return "temporaries" if is_temporary(path.name) else "foreign", path


RESULT_FOLDERS: Final[dict[str, ResultKind]] = {
    "signatures": "signature",
    "classifications": "classification",
    "tracks": "track",
}
# Files under way; keys and audit log; stores of owners other than the folder's own; what a
# cluster's workers are known by.
_OF_THE_SERVICE: Final = ("spool", "access", "owners", "cluster", *_COHORT_FILES)
_KEPT_BESIDE: Final = ("deleted", "backup.json")
FOLDERS: Final = ("sequences", "templates", "images", "models", "norms", *RESULT_FOLDERS)


def is_id(text: object) -> bool:
    """Return whether this is a sha256 in lower-case hex; only such a text becomes a file name."""
    return isinstance(text, str) and re.fullmatch(_ID, text) is not None


def is_key(text: object) -> bool:
    """Return whether this is a key of parameters."""
    return isinstance(text, str) and re.fullmatch(_KEY, text) is not None


def _name(match: re.Match[str]) -> Any:
    """Give what a file is of: an id or a name, a result, or a version of a model."""
    parts = match.groupdict()
    if "kind" in parts:
        kind: Any = parts["kind"]
        return ResultName(kind, parts["id"], parts["model"] or "", parts["key"])
    if "version" in parts:
        return ModelReference(parts["name"], int(parts["version"]))
    return parts["id"]


def _files(folder: Path) -> Iterator[Path]:
    if not folder.is_dir():
        return
    for shard in folder.iterdir():
        if shard.is_dir():
            yield from shard.iterdir()
        else:
            yield shard


FORM: Final = JsonForm(
    "sequence-record",
    3,
    "Run `modalmotion store rebuild`, which restores it from the other files.",
)
IMAGES_FORM: Final = JsonForm("images-record", 3, "Delete the images, and send them again.")

LONGEST_NAME: Final = 200


class Unset(Enum):
    """An argument that was left out, where None has a meaning of its own."""

    UNSET = "unset"


UNSET: Final = Unset.UNSET


@shown("n_frames", "n_vertices", "n_faces", "topology", "unit", "name", "subject", "label", "id")
@dataclass(frozen=True)
class SequenceRecord:
    """All that the store knows of a sequence without reading its vertices.

    Parameters
    ----------
    id : str
        sha256 of the content, in hex.
    n_frames, n_vertices, n_faces : int
    topology : str or None
        As stated by the sender.
    grid : tuple of int or None
    unit : str or None
        Of lengths.
    has_times : bool
    subject, label : str or None
        Whose it is, and what it shows, as the user says.
    created : str
        When it was first put, UTC, ISO 8601 with microseconds.
    has_upload : bool
        Whether the vertices are kept.
    facts : Facts
        As stated now, and stored here alone: the file of its vertices has none, so
        that a correction, or the removal of what identifies a person, leaves nothing behind.
    span : float or None, s
        From the first time to the last; None if times are unknown.
    name : str or None
        What its owner calls it, such as the name of the file.
    """

    id: str
    n_frames: int
    n_vertices: int
    n_faces: int
    topology: str | None
    grid: tuple[int, ...] | None
    unit: str | None
    has_times: bool
    subject: str | None
    label: str | None
    created: str
    has_upload: bool
    facts: mesh.Facts = mesh.NO_FACTS
    span: float | None = None
    name: str | None = None


def record_of(
    sequence: MeshSequence,
    *,
    created: str,
    has_upload: bool,
    subject: str | None = None,
    label: str | None = None,
) -> SequenceRecord:
    """Record of a sequence."""
    same = ("id", "n_frames", "n_vertices", "grid", "unit", "facts", "span")
    return SequenceRecord(
        **{name: getattr(sequence, name) for name in same},
        n_faces=len(sequence.faces),
        topology=None if sequence.topology is None else sequence.topology.name,
        has_times=sequence.times is not None,
        subject=subject,
        label=label,
        created=created,
        has_upload=has_upload,
    )


def record_to_json(record: SequenceRecord) -> bytes:
    """Write a record as JSON that ends with the sha256 of the text before it."""
    return FORM.write(record_values(record))


def record_values(record: SequenceRecord) -> dict[str, Any]:
    """Values of a record by name, facts as JSON has them."""
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    return {**values, "facts": mesh.facts_as_json(record.facts)}


def read_record(path: Path) -> SequenceRecord:
    """Read a record.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged.
    StoreError
        If it was written by another version.
    """
    return record_from(FORM.read(path))


def record_from(values: dict[str, Any]) -> SequenceRecord:
    """Make a record of `record_values`, lists for tuples; without facts where there are none."""
    grid, facts = values["grid"], mesh.facts_from_json(values.get("facts", {}))
    return SequenceRecord(
        **{**values, "grid": None if grid is None else tuple(grid), "facts": facts}
    )


def require_name(name: str, text: str | None) -> None:
    """Check a name, a subject or a label.

    Raises
    ------
    ParameterError
        If it is too long, or not `is_readable`.
    """
    if text is not None and len(text) > LONGEST_NAME:
        raise errors.ParameterError(
            f"The {name} has {len(text)} characters, more than {LONGEST_NAME}.",
            remedy="Use a short name.",
            details={"longest": LONGEST_NAME},
        )
    if text is not None and not is_readable(text):
        raise errors.ParameterError(
            f"The {name} {text[:40]!a} contains control characters, or was not sent in UTF-8.",
            remedy="Use letters, digits, signs and spaces.",
        )
