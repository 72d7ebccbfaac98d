"""Labelled recordings as training reads them: their motions in one basis, labels and subjects."""

from __future__ import annotations

import hashlib
import itertools
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.cases import (
    UNUSABLE,
    AnyCase,
    LeftOut,
    TrainingCase,
    left_out_notes,
)
from modalmotion.classification.caveats import cohort_notes
from modalmotion.classification.model import Readable
from modalmotion.classification.motion import Motion
from modalmotion.classification.options import FEWER_MODES, OnError, TrainingOptions
from modalmotion.errors import ModalMotionError, ParameterError, UnlikeCasesError
from modalmotion.mesh.sequence import MEAN
from modalmotion.modes.order import common_count
from modalmotion.modes.topology import MESH
from modalmotion.signature.making import ModalSignature, SignatureKind, SignatureParameters
from modalmotion.signature.value import first_modes
from modalmotion.template import GivenLandmarks
from modalmotion.template.body_frame import Components

# Cases that are read in one piece of work: some 0.1 s of it.
_IN_ONE_PIECE: Final = 16

# Cases that an error names.
_MOST_NAMED: Final = 3

Progress = Callable[[int], None]
Conditions = Mapping[str, float | str]
Groups = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Cohort:
    """Labelled motions that compare.

    Parameters
    ----------
    readable : Readable
    motions : tuple of Motion
    classes : tuple of str
    y : (cases,) int64
    groups : (cases,) int64
        Cases that must not be on both sides of a split.
    subjects, sequence_ids, names : tuple of str
    conditions : tuple of mapping
        What is known of each recording beside its motion: see `conditions_of`.
    numbers : (cases,) int64
        Of each case, as it was given.
    n_given : int
        Number of cases that were given.
    walls : bool
        Whether every case states the zero of theta.
    notes : tuple of str
    """

    readable: Readable
    motions: tuple[Motion, ...]
    classes: tuple[str, ...]
    y: NDArray[np.int64]
    groups: Groups
    subjects: tuple[str, ...]
    sequence_ids: tuple[str, ...]
    names: tuple[str, ...]
    conditions: tuple[Conditions, ...]
    numbers: NDArray[np.int64]
    n_given: int
    walls: bool
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.y)

    @property
    def hash(self) -> str:
        """sha256 in hex of ids, labels and subjects, in any order."""
        rows = zip(self.sequence_ids, self.y, self.subjects, strict=True)
        lines = sorted(f"{id_} {self.classes[k]} {subject}" for id_, k, subject in rows)
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()

    @property
    def basis(self) -> str:
        """Its modes and their kind, in words."""
        kind = self.readable.parameters.kind
        what = "normal displacement" if kind == SignatureKind.OFFSET else str(kind)
        return f"{what}, {self.readable.topology}"


def collect_cohorts(
    cases: Iterable[AnyCase],
    offsets: Iterable[AnyCase] | None,
    options: TrainingOptions,
    progress: Progress | None = None,
) -> tuple[Cohort, ...]:
    """Read a cohort in each basis in which all its recordings compare.

    Each recording is fitted as its own shape says. Where these are several topologies, all are
    fitted in each of them and with the spring modes of their mesh, and what all allow remains. What
    does not state that its points follow the tissue is read by its normal displacements, too.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
        Sequences are fitted; signatures are taken as they are.
    offsets : iterable of TrainingCase or CaseSource, or None
        The same cases with their signatures of the kind offset, where `cases` are signatures.
    options : TrainingOptions
        A topology and a kind that they state are the only ones.
    progress : callable, optional
        Called with the number of readings that are done.

    Raises
    ------
    UnlikeCasesError
        If there is no such basis.
    ParameterError
        If a label is missing, a signature cannot be used, one recording has two classes, or there
        are fewer than two classes.
    ModalMotionError
        If a case cannot be read or fitted.
    """
    # They may be read several times.
    cohort = list(cases) if iter(cases) is cases else cases
    first = options.signature_parameters
    cohorts = [_cohort(read, options) for read in _alike(cohort, options, first, progress)]
    trackings = {str(motion.signature.facts.tracking) for motion in cohorts[0].motions}
    others = cohort if offsets is None else offsets
    is_fitted = offsets is not None or any(
        not isinstance(getattr(case, "motion", None), ModalSignature) for case in others
    )
    if options.kind is not None or trackings == {"material"} or not is_fitted:
        return tuple(cohorts)
    try:
        slid = replace(first, kind=SignatureKind.OFFSET)
        reads = list(_alike(others, options, slid, progress))
    except ModalMotionError:
        return tuple(cohorts)
    second = [_cohort(read, options) for read in reads if read.kind == SignatureKind.OFFSET]
    if second and trackings == {"offset"}:
        return tuple(second)
    same = [one for one in second if np.array_equal(one.numbers, cohorts[0].numbers)]
    return (*cohorts, *same)


def conditions_of(signature: ModalSignature) -> Conditions:
    """Frames, frame rate (Hz), vertices, modality, and the covariates that the sender states."""
    facts, times = signature.facts, signature.times
    conditions: dict[str, float | str] = {
        "frames": signature.n_frames,
        "vertices": signature.n_vertices,
    }
    if times is not None and signature.n_frames > 1 and times[-1] > times[0]:
        rate = float((signature.n_frames - 1) / (times[-1] - times[0]))
        # Times have been rounded, and rates are compared for equality.
        conditions["frame rate"] = float(f"{rate:.3g}")
    if facts.modality is not None:
        conditions["modality"] = facts.modality
    for name, value in facts.covariates.items():
        conditions[name if name not in conditions else f"covariate {name}"] = value
    return conditions


def basis_of(signature: ModalSignature) -> tuple[Any, ...]:
    """Give what signatures must share so that their modes compare."""
    p, modes = signature.parameters, signature.modes
    return (
        *(signature.surface, modes.connectivity_id, p.kind, p.remove_rotation),
        *(p.components, p.reference == MEAN),
    )


def readable_of(signatures: Sequence[ModalSignature]) -> Readable:
    """Describe what signatures of one basis share: their common first modes."""
    first = signatures[0]
    parameters = replace(
        first.parameters,
        modes=min(common_count(signature.modes) for signature in signatures),
        template=None,
        landmarks=GivenLandmarks(),
        grid=None,
        reference=MEAN if first.parameters.reference == MEAN else 0,
    )
    n = int(parameters.modes or 0)
    return Readable(first.surface, n, first.modes.connectivity_id, parameters)


class _Read(NamedTuple):
    """Cases with their signatures, the numbers they were given by, and those left out."""

    cases: tuple[TrainingCase, ...]
    numbers: tuple[int, ...]
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...] = ()

    @property
    def kind(self) -> SignatureKind:
        return self.cases[0].signature.kind

    def surfaces(self) -> list[str]:
        """Topologies, the commonest first."""
        counts = Counter(case.signature.surface for case in self.cases)
        return [surface for surface, _ in counts.most_common()]

    def commonest(self) -> _Read:
        """Keep the cases of the commonest basis; leave the others out."""
        values = [basis_of(case.signature) for case in self.cases]
        most = Counter(values).most_common(1)[0][0] if values else None
        kept = [k for k, value in enumerate(values) if value == most]
        odd = [
            LeftOut(
                case.name or f"case {number}",
                f"Its {len(case.signature.modes)} modes of a {case.signature.surface} do not "
                "compare with those of most.",
            )
            for case, number, value in zip(self.cases, self.numbers, values, strict=True)
            if value != most
        ]
        return self._replace(
            cases=tuple(self.cases[k] for k in kept),
            numbers=tuple(self.numbers[k] for k in kept),
            left_out=(*self.left_out, *odd),
        )


def _alike(
    cases: Iterable[AnyCase],
    options: TrainingOptions,
    parameters: SignatureParameters,
    progress: Progress | None,
) -> Sequence[_Read]:
    """Read the cases in each basis that they share; with "leave out" in that of most."""
    leaves_out = options.on_error == OnError.LEAVE_OUT
    read = _read(cases, options, parameters, progress)
    kept = read.commonest()
    if len(kept.cases) == len(read.cases):
        return (read,)
    surfaces = read.surfaces()
    others: list[_Read] = []
    if parameters.topology is None and len(surfaces) > 1:
        for basis in [
            *(replace(parameters, topology=name) for name in surfaces if name != MESH),
            replace(parameters, topology=MESH),
        ]:
            try:
                other = _read(cases, options, basis, progress)
            except ModalMotionError:
                continue
            most = other.commonest()
            if leaves_out or len(most.cases) == len(other.cases):
                note = f"Their shapes are {' or '.join(surfaces)}; all are read as"
                others.append(most._replace(notes=(f"{note} {most.surfaces()[0]}.",)))
    candidates = [*others, kept] if leaves_out else others
    if not candidates:
        raise _unlike(read, kept)
    fewest = min(len(one.left_out) for one in candidates)
    return [one for one in candidates if len(one.left_out) == fewest]


def _unlike(read: _Read, kept: _Read) -> UnlikeCasesError:
    odd = kept.left_out[len(read.left_out) :]
    names = ", ".join(case.name for case in odd[:_MOST_NAMED])
    names += ", and others" if len(odd) > _MOST_NAMED else ""
    return UnlikeCasesError(
        f"The training cases do not compare: {len(odd)} have other modes than most ({names}). "
        f"{odd[0].reason}",
        remedy="Leave them out (--skip-unreadable, on_error = 'leave out'), state one topology for "
        "all, such as topology = sphere (--topology sphere), or give the sequences themselves, "
        "which are then fitted in one basis.",
        details={"left_out": [case.name for case in odd[:20]]},
    )


def _read(
    cases: Iterable[AnyCase],
    options: TrainingOptions,
    parameters: SignatureParameters,
    progress: Progress | None,
) -> _Read:
    """Read cases wherever joblib works, in their order."""
    from joblib import Parallel, delayed

    numbered = enumerate(cases)
    pieces = iter(lambda: tuple(itertools.islice(numbered, _IN_ONE_PIECE)), ())
    works = (delayed(_read_piece)(piece, options, parameters) for piece in pieces)
    results = Parallel(return_as="generator", batch_size=1)(works)
    kept: list[tuple[int, TrainingCase]] = []
    left_out: list[LeftOut] = []
    for number, case in enumerate(itertools.chain.from_iterable(results)):
        if isinstance(case, LeftOut):
            left_out.append(case)
        else:
            kept.append((number, case))
        if progress is not None:
            progress(number + 1)
    return _Read(tuple(case for _, case in kept), tuple(n for n, _ in kept), tuple(left_out))


def _read_piece(
    piece: tuple[tuple[int, AnyCase], ...],
    options: TrainingOptions,
    parameters: SignatureParameters,
) -> list[TrainingCase | LeftOut]:
    results: list[TrainingCase | LeftOut] = []
    for number, source in piece:
        try:
            read = source if isinstance(source, TrainingCase) else source.read()
            case = read.fitted(parameters, FEWER_MODES if options.modes is None else ())
            _require_usable(case, number)
        except UNUSABLE as error:
            if options.on_error == OnError.RAISE:
                raise
            results.append(LeftOut.of(error, source.name or f"case {number}"))
        else:
            results.append(case)
    return results


def _require_usable(case: TrainingCase, number: int) -> None:
    signature, called = case.signature, f"The training case {case.name or number}"
    faults = (
        (not str(case.label or "").strip(), "has no label", "Give every case its class."),
        (signature.n_frames < 2, "has one frame, which shows no motion", "Leave it out."),
        (
            signature.parameters.components != Components.CARTESIAN,
            "has radial, tangential and axial amplitudes",
            "Fit it with components = cartesian.",
        ),
        (
            not signature.modes.length_of(signature.lengths, signature.angular_frequencies, 1.0)
            > 0.0,
            "has no extent in its reference frame",
            "Choose another reference.",
        ),
    )
    for is_faulty, what, remedy in faults:
        if is_faulty:
            raise ParameterError(
                f"{called} {what}.",
                remedy=remedy,
                details={"case": number, "sequence_id": signature.sequence_id},
            )


def _cohort(read: _Read, options: TrainingOptions) -> Cohort:
    rows, numbers = _distinct(read)
    classes = tuple(sorted({case.label for case in rows}))
    if len(classes) < 2:
        without = f", without the {len(read.left_out)} that were left out" if read.left_out else ""
        raise ParameterError(
            f"The training cases have {len(classes)} class(es){without}.",
            remedy="Give cases of at least two classes.",
            details={"classes": list(classes), "left_out": [str(c) for c in read.left_out[:20]]},
        )
    readable = readable_of([case.signature for case in rows])
    signatures = [first_modes(case.signature, readable.n_modes) for case in rows]
    subjects, groups = _grouped(rows, options.groups)
    n_same, most = len(read.cases) - len(rows), options.signature_parameters.modes or 0
    notes = [*left_out_notes(read.left_out), *read.notes]
    if n_same:
        notes.append(f"{n_same} cases came twice and counted once.")
    if options.modes is None and readable.n_modes < most:
        notes.append(f"Not all have {most} modes: the first {readable.n_modes} are read of all.")
    landmarks = [signature.landmarks for signature in signatures]
    motions = tuple(map(Motion, signatures))
    sizes = [motion.log_size for motion in motions]
    notes += cohort_notes(rows, sizes)
    return Cohort(
        readable=readable,
        motions=motions,
        classes=classes,
        y=np.array([classes.index(case.label) for case in rows]),
        groups=groups,
        subjects=subjects,
        sequence_ids=tuple(case.sequence_id for case in rows),
        names=tuple(case.name for case in rows),
        conditions=tuple(map(conditions_of, signatures)),
        numbers=np.array(numbers),
        n_given=len(read.cases) + len(read.left_out),
        walls=all(one is not None and "theta_zero" in one.given for one in landmarks),
        notes=tuple(notes),
    )


def _distinct(read: _Read) -> tuple[list[TrainingCase], list[int]]:
    """Leave out what came twice; a recording of two classes is refused."""
    known: dict[str, TrainingCase] = {}
    rows, numbers = [], []
    for number, case in zip(read.numbers, read.cases, strict=True):
        first = known.get(case.sequence_id)
        if first is None:
            known[case.sequence_id] = case
            rows.append(case)
            numbers.append(number)
        elif first.label != case.label:
            names = {name for name in (first.name, case.name) if name}
            what = " and ".join(sorted(names)) or f"The recording {case.sequence_id[:12]}"
            raise ParameterError(
                f"{what} has two classes, {first.label!r} and {case.label!r}.",
                remedy="Give each recording one class.",
                details={"case": number, "sequence_id": case.sequence_id},
            )
    return rows, numbers


def _grouped(cases: Sequence[TrainingCase], by: str | None) -> tuple[tuple[str, ...], Groups]:
    """Subjects, and groups of cases that share a subject or a covariate."""
    subjects = tuple(case.subject or f"sequence {case.sequence_id}" for case in cases)
    keys = [subjects]
    if by is not None:
        keys.append(tuple(f"\0{value}" for value in _values_of(by, cases)))
    # Join what shares a key until nothing changes: chains of subjects and sites are short.
    groups = np.arange(len(cases))
    while True:
        before = groups.copy()
        for names in keys:
            _, place = np.unique(np.array(names), return_inverse=True)
            least = np.full(int(place.max()) + 1, len(cases))
            np.minimum.at(least, place, groups)
            groups = least[place]
        if np.array_equal(before, groups):
            break
    return subjects, np.unique(groups, return_inverse=True)[1]


def _values_of(column: str, cases: Sequence[TrainingCase]) -> Iterator[str]:
    """Give a covariate of each case as text; what is unknown is of a value of its own."""
    known = {name.casefold(): name for case in cases for name in case.covariates}
    if column.casefold() not in known:
        names = ", ".join(sorted(set(known.values()))) or "there is none"
        raise ParameterError(
            f"The option 'groups' names the covariate {column[:80]!r}, which no case has.",
            remedy=f"Use a column of the manifest or a covariate of the cases: {names}.",
            details={"option": "groups", "covariates": sorted(set(known.values()))},
        )
    for number, case in enumerate(cases):
        folded = {name.casefold(): value for name, value in case.covariates.items()}
        yield str(folded.get(column.casefold(), f"unknown {number}"))
