"""What training keeps of labelled signatures: their features, nothing else."""

from __future__ import annotations

import hashlib
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classify.cases import CaseFile, TrainingCase
from modalmotion.classify.model import Readable
from modalmotion.classify.options import PoseOf, Timing, TrainingOptions, Walls
from modalmotion.errors import ParameterError
from modalmotion.features import (
    READINGS,
    Column,
    FeatureReader,
    Motion,
    axis_features,
    has_axis,
    mean_motion,
    motion_of,
)
from modalmotion.modes import ModeSet
from modalmotion.signature import ModalSignature, SignatureParameters
from modalmotion.spring_modes import SpringSpectrum
from modalmotion.template import GivenLandmarks
from modalmotion.template.landmarks import WEAK

# A cycle whose next frame would be the first closes within this many usual steps.
_CLOSED: Final = 2.5

# Motions that the typical one is made of; more cost time and move it little.
_MOST_TYPICAL: Final = 200

# Cases that are read in one piece of work: some 0.1 s of it.
_IN_ONE_PIECE: Final = 16

# Times that the readings are chosen anew from the classes they gave.
_N_ROUNDS: Final = 5


@dataclass(frozen=True, eq=False)
class CaseTable:
    """Features of a training set.

    Parameters
    ----------
    example : ModalSignature
        One of them, for its modes.
    readable : Readable
    reader : FeatureReader
        Without a typical motion.
    classes : tuple of str
    y : (cases,) int64
    groups : (cases,) int64
        Cases that must not be on both sides of a split.
    subjects : tuple of str
    hash : str
        sha256 in hex of ids, labels and subjects, in any order.
    values : (cases, readings, features) float64
        About an axis; else empty.
    motions : tuple of Motion
        Where there is no axis.
    sizes, smooth_shares : (cases,) float64
        Of the motions.
    notes : tuple of str
    """

    example: ModalSignature
    readable: Readable
    reader: FeatureReader
    classes: tuple[str, ...]
    y: NDArray[np.int64]
    groups: NDArray[np.int64]
    subjects: tuple[str, ...]
    hash: str
    values: NDArray[np.float64]
    motions: tuple[Motion, ...]
    sizes: NDArray[np.float64]
    smooth_shares: NDArray[np.float64]
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.y)

    def readers(self) -> tuple[FeatureReader, ...]:
        """Choices of features that may be tried."""
        if self.reader.has_axis or self.reader.waves(self.example).sines.max() >= 0:
            return (self.reader,)
        empty = np.zeros((len(self.motions[0].terms), self.readable.n_modes, 3), np.complex128)
        return self.reader, replace(self.reader, typical=empty)

    def fitted(
        self, reader: FeatureReader, rows: NDArray[np.int64], pose: PoseOf | str
    ) -> FeatureReader:
        """Give the reader the typical motion of some cases."""
        if reader.typical is None or pose == PoseOf.FIXED:
            return reader
        chosen = rows[:: -(-len(rows) // _MOST_TYPICAL)]
        motions = [self.motions[i].terms for i in chosen]
        return replace(reader, typical=mean_motion(motions, is_cycle=reader.is_cycle))

    def features(self, reader: FeatureReader) -> NDArray[np.float64]:
        """Features of all cases, (cases, readings, features) float64."""
        if reader.has_axis:
            return self.values
        return np.stack([reader.of(self.example, motion).values for motion in self.motions])

    def columns(self, reader: FeatureReader) -> tuple[Column, ...]:
        """Names of the features."""
        return reader.read(self.example).columns


@dataclass(frozen=True, eq=False)
class _Row:
    label: str
    subject: str | None
    sequence_id: str
    gap: float
    zero_is_given: bool
    zero_is_known: bool
    axis: tuple[NDArray[np.float64], float, float] | None
    walls: NDArray[np.float64] | None
    cycle: Motion
    course: Motion


@dataclass(frozen=True, eq=False)
class _Read:
    """A case as read by whoever did the work; the signature itself is kept of the first only."""

    row: _Row
    surface: str
    parameters: SignatureParameters
    modes: ModeSet | SpringSpectrum
    signature: ModalSignature | None


def collect(
    cases: Iterable[TrainingCase | CaseFile],
    options: TrainingOptions,
    progress: Callable[[int], None] | None = None,
) -> CaseTable:
    """Read the features of labelled signatures, a few at a time, wherever joblib works.

    Raises
    ------
    ParameterError
        If a label is missing, a signature cannot be used or is of another kind than the
        others, one recording has two classes, or there are fewer than two classes.
    """
    rows: list[_Row] = []
    by_id: dict[str, list[_Row]] = {}
    labels: dict[str, str] = {}
    first: _Read | None = None
    topologies: dict[str, list[str]] = {}
    n_same = 0
    for number, read in enumerate(_read(cases, options)):
        row = read.row
        first = read if first is None else first
        _require_alike(read, first, number)
        known = labels.setdefault(row.sequence_id, row.label)
        if known != row.label:
            raise ParameterError(
                f"The recording {row.sequence_id[:12]} has two classes, {known!r} "
                f"and {row.label!r}.",
                remedy="Give each recording one class.",
                details={"case": number, "sequence_id": row.sequence_id},
            )
        topologies.setdefault(read.surface, []).append(row.sequence_id)
        # The same recording with the same modes says nothing new; as another topology it does.
        same = by_id.setdefault(row.sequence_id, [])
        if any(np.array_equal(r.cycle.terms, row.cycle.terms) for r in same):
            n_same += 1
        else:
            rows.append(row)
            same.append(row)
        if progress is not None:
            progress(number + 1)
    example = None if first is None else first.signature
    classes = tuple(sorted({row.label for row in rows}))
    if example is None or len(classes) < 2:
        raise ParameterError(
            f"The training cases have {len(classes)} class(es).",
            remedy="Give cases of at least two classes.",
            details={"classes": list(classes)},
        )
    notes = [f"{n_same} cases came twice and counted once."] if n_same else []
    return _table(rows, classes, example, topologies, options, notes)


def _read(cases: Iterable[TrainingCase | CaseFile], options: TrainingOptions) -> Iterator[_Read]:
    """Read cases, in their order."""
    from joblib import Parallel, delayed

    numbered = enumerate(cases)
    pieces = iter(lambda: tuple(itertools.islice(numbered, _IN_ONE_PIECE)), ())
    works = (delayed(_read_piece)(piece, options) for piece in pieces)
    read = Parallel(return_as="generator", batch_size=1)(works)
    return itertools.chain.from_iterable(read)


def _read_piece(
    piece: tuple[tuple[int, TrainingCase | CaseFile], ...], options: TrainingOptions
) -> list[_Read]:
    found = []
    for number, given in piece:
        case = given.read() if isinstance(given, CaseFile) else given
        _require_usable(case, number, options)
        signature = case.signature
        found.append(
            _Read(
                _row(case, options),
                signature.surface,
                signature.parameters,
                signature.modes,
                None if number else signature,
            )
        )
    return found


def _table(
    rows: list[_Row],
    classes: tuple[str, ...],
    example: ModalSignature,
    topologies: dict[str, list[str]],
    options: TrainingOptions,
    notes: list[str],
) -> CaseTable:
    gap = float(np.median([row.gap for row in rows]))
    is_cycle = options.timing == Timing.CYCLE or (options.timing == Timing.AUTO and gap < _CLOSED)
    use_axis = is_cycle and all(row.axis is not None for row in rows)
    walls = _walls(rows, options)
    if len(topologies) > 1 and not use_axis:
        common, *rare = sorted(topologies, key=lambda name: -len(topologies[name]))
        ids = [name for topology in rare for name in topologies[topology]]
        raise ParameterError(
            f"The training cases have the topologies {', '.join(sorted(topologies))}: most are "
            f"{common}, and {len(ids)} are not, such as {', '.join(i[:12] for i in ids[:3])}.",
            remedy="Give cases of one topology; only cups and cylinders over a cycle mix.",
            details={"sequence_ids": ids[:20], "n_sequences": len(ids)},
        )
    found = [row.cycle if is_cycle else row.course for row in rows]
    values = np.zeros((0, 0, 0))
    if use_axis:
        both = [row.walls if walls else row.axis[0] for row in rows if row.axis is not None]
        values = np.array(both)
    seen = [(motion.size, motion.smooth_share) for motion in found]
    if use_axis:
        seen = [row.axis[1:] for row in rows if row.axis is not None]
    sizes, shares = zip(*seen, strict=True)
    subjects, groups, mixed = _groups(rows)
    if mixed:
        notes = [*notes, f"{mixed} recordings are of two subjects each; these are kept together."]
    lines = sorted(f"{r.sequence_id} {r.label} {s}" for r, s in zip(rows, subjects, strict=True))
    parameters = replace(
        example.parameters, template=None, landmarks=GivenLandmarks(), grid=None, reference=0
    )
    modes = example.modes
    return CaseTable(
        example=example,
        readable=Readable(
            topologies=tuple(sorted(topologies)),
            n_modes=len(example.modes),
            connectivity_id=modes.connectivity_id if isinstance(modes, SpringSpectrum) else "",
            parameters=parameters,
        ),
        reader=FeatureReader(use_axis, is_cycle, options.harmonics, walls),
        classes=classes,
        y=np.array([classes.index(row.label) for row in rows]),
        groups=groups,
        subjects=subjects,
        hash=hashlib.sha256("\n".join(lines).encode()).hexdigest(),
        values=values,
        motions=() if use_axis else tuple(found),
        sizes=np.array(sizes),
        smooth_shares=np.array(shares),
        notes=tuple(notes),
    )


def _row(case: TrainingCase, options: TrainingOptions) -> _Row:
    signature = case.signature
    landmarks = signature.landmarks
    axis = walls = None
    if has_axis(signature):
        n = options.harmonics
        read = axis_features(signature, n, max(1, n - 1))
        axis = read.values, read.motion, read.smooth_share
        if landmarks is not None:
            walls = axis_features(signature, n, max(1, n - 1), walls=True).values
    kinds = [FeatureReader(False, is_cycle, options.harmonics, False) for is_cycle in (True, False)]
    cycle, course = (motion_of(signature, kind) for kind in kinds)
    return _Row(
        label=case.label,
        subject=case.subject,
        sequence_id=signature.sequence_id,
        gap=signature.closure_gap,
        zero_is_given=landmarks is not None and "theta_zero" in landmarks.given,
        zero_is_known=zero_is_known(signature),
        axis=axis,
        walls=walls,
        cycle=cycle,
        course=course,
    )


def zero_is_known(signature: ModalSignature) -> bool:
    """Whether the shape or the sender says where theta starts."""
    landmarks = signature.landmarks
    return landmarks is not None and landmarks.strengths.get("theta_zero", 0.0) >= WEAK


def _walls(rows: list[_Row], options: TrainingOptions) -> bool:
    if options.walls == Walls.NO:
        return False
    if options.walls == Walls.AUTO:
        return all(row.zero_is_given for row in rows)
    unknown = sum(not row.zero_is_known for row in rows)
    if unknown:
        raise ParameterError(
            f"Walls are to be told apart, but theta has no zero in {unknown} cases.",
            remedy="State the landmark theta_zero, or leave the option 'walls' out.",
        )
    return True


def _groups(rows: list[_Row]) -> tuple[tuple[str, ...], NDArray[np.int64], int]:
    """Subjects, groups of whatever shares a subject or a recording, recordings with two."""
    subjects = tuple(row.subject or f"sequence {row.sequence_id}" for row in rows)
    parent: dict[str, str] = {}

    def root(name: str) -> str:
        while parent.setdefault(name, name) != name:
            name = parent[name]
        return name

    seen: dict[str, set[str]] = {}
    for row, subject in zip(rows, subjects, strict=True):
        parent[root(subject)] = root(f"sequence {row.sequence_id}")
        if row.subject is not None:
            seen.setdefault(row.sequence_id, set()).add(subject)
    roots = [root(subject) for subject in subjects]
    places = {name: k for k, name in enumerate(dict.fromkeys(roots))}
    mixed = sum(len(names) > 1 for names in seen.values())
    return subjects, np.array([places[name] for name in roots]), mixed


def best_readings(
    values: NDArray[np.float64], y: NDArray[np.int64], n_classes: int
) -> NDArray[np.float64]:
    """Features in the reading that is nearer to the case's own class, found by turns.

    Cases are taken to be right-handed, so only the side of inward is to be found.
    """
    from modalmotion.classify.domain import domain_shape

    if values.shape[1] == 1:
        return values[:, 0]
    both = values[:, [k for k, reading in enumerate(READINGS) if not reading.is_mirrored]]
    X = both[:, 0]
    for _ in range(_N_ROUNDS):
        centre, scale = X.mean(axis=0), np.where(X.std(axis=0) > 0, X.std(axis=0), np.inf)
        means, whitening = domain_shape((X - centre) / scale, y, n_classes)
        apart = ((both - centre) / scale - means[y][:, None]) @ whitening
        chosen = (apart**2).sum(axis=2).argmin(axis=1)
        X = both[np.arange(len(both)), chosen]
    return X


def class_counts(labels: Iterable[str]) -> dict[str, int]:
    """How often each label occurs, sorted by label."""
    return dict(sorted(Counter(labels).items()))


def _require_usable(case: TrainingCase, number: int, options: TrainingOptions) -> None:
    signature = case.signature
    if not str(case.label or "").strip():
        raise ParameterError(
            f"The training case {number} has no label.",
            remedy="Give every case the name of its class, or leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
    if signature.n_frames < 2:
        raise ParameterError(
            f"The training case {number} has one frame, which shows no motion.",
            remedy="Leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
    asked = signature.parameters.modes
    if options.modes not in (asked, len(signature.modes)):
        raise ParameterError(
            f"The training case {number} has {len(signature.modes)} modes, but {options.modes} "
            "were asked for.",
            remedy=f"Fit the signatures with modes={options.modes}.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )


def _require_alike(read: _Read, example: _Read, number: int) -> None:
    a, b = read.parameters, example.parameters
    same = (
        a.weights == b.weights
        and a.remove_rotation == b.remove_rotation
        and a.components == b.components
        and len(read.modes) == len(example.modes)
        and isinstance(read.modes, SpringSpectrum) == isinstance(example.modes, SpringSpectrum)
    )
    if same and isinstance(read.modes, SpringSpectrum):
        assert isinstance(example.modes, SpringSpectrum)  # noqa: S101 (just compared)
        if read.modes.connectivity_id != example.modes.connectivity_id:
            raise ParameterError(
                f"The training case {number} is of another mesh than the first, and spring modes "
                "compare within one mesh only.",
                remedy="Give recordings of one mesh, or of surfaces with natural coordinates.",
                details={"case": number, "sequence_id": read.row.sequence_id},
            )
    if not same:
        raise ParameterError(
            f"The training cases differ in their modes: case {number} has {len(read.modes)} "
            f"of a {read.surface}, {a.components}, weights {a.weights}; the first has "
            f"{len(example.modes)} of a {example.surface}, {b.components}, weights {b.weights}.",
            remedy="Fit all signatures with the same parameters.",
            details={"case": number, "sequence_id": read.row.sequence_id},
        )
