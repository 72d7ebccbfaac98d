"""Labelled recordings as training reads them: their motions in one basis, labels and subjects."""

import hashlib
import itertools
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import length_hint
from typing import Any, Final, NamedTuple

import numpy as np
import scipy

from modalmotion import errors, template
from modalmotion.classification import caveats, model, motion_features
from modalmotion.classification.cases import (
    UNUSABLE,
    AnyCase,
    LeftOut,
    TrainingCase,
    left_out_notes,
)
from modalmotion.classification.motion import Motion
from modalmotion.classification.options import FEWER_MODES, OnError, TrainingOptions
from modalmotion.mesh import sequence, spring_modes
from modalmotion.modes.topologies import MESH
from modalmotion.notes import Note
from modalmotion.progress import Reporter, reported
from modalmotion.representation import Ints
from modalmotion.signature.making import ModalSignature, SignatureKind, SignatureParameters
from modalmotion.signature.value import first_modes
from modalmotion.template import body_frame

# Cases that are read in one piece of work: some 0.1 s of it.
_IN_ONE_PIECE: Final = 16

# Cases that an error names.
_MOST_NAMED: Final = 3

Conditions = Mapping[str, float | str]


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
    notes : tuple of Note
    """

    readable: model.Readable
    motions: tuple[Motion, ...]
    classes: tuple[str, ...]
    y: Ints
    groups: Ints
    subjects: tuple[str, ...]
    sequence_ids: tuple[str, ...]
    names: tuple[str, ...]
    conditions: tuple[Conditions, ...]
    numbers: Ints
    n_given: int
    walls: bool
    notes: tuple[Note, ...]

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
        return f"{self.readable.parameters.kind.replace('_', ' ')}, {self.readable.topology}"


def collect_cohorts(
    cases: Iterable[AnyCase],
    normal_displacements: Iterable[AnyCase] | None,
    options: TrainingOptions,
    progress: Reporter | None = None,
) -> tuple[Cohort, ...]:
    """Read a cohort in each basis in which all its recordings compare.

    Each recording is fitted as its own shape says. Where these are several topologies, all are
    fitted in each of them and with the spring modes of their mesh, and what all allow remains. What
    does not state that its points follow the tissue is read by its normal displacements, too.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
        Sequences are fitted; signatures are taken as they are.
    normal_displacements : iterable of TrainingCase or CaseSource, or None
        The same cases with their signatures of normal displacements, where `cases` are signatures.
    options : TrainingOptions
        A topology and a kind that they state are the only ones.
    progress : callable, optional
        Called with the number of cases read, in each basis anew, and of all as far as known.

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
    first, leaves_out = options.signature_parameters, options.on_error == OnError.LEAVE_OUT
    fewer = FEWER_MODES if options.modes is None else ()

    def in_each(of: Iterable[AnyCase], parameters: SignatureParameters) -> list[Cohort]:
        found = alike(of, parameters, fewer, leaves_out=leaves_out, progress=progress)
        return [_cohort(one, options) for one in found]

    cohorts = in_each(cohort, first)
    trackings = {str(motion.signature.facts.tracking) for motion in cohorts[0].motions}
    others = cohort if normal_displacements is None else normal_displacements
    is_fitted = normal_displacements is not None or any(
        not isinstance(getattr(case, "motion", None), ModalSignature) for case in others
    )
    if options.kind is not None or trackings == {"material"} or not is_fitted:
        return tuple(cohorts)
    try:
        second = in_each(others, replace(first, kind=SignatureKind.NORMAL_DISPLACEMENT))
    except errors.ModalMotionError:
        return tuple(cohorts)
    second = [one for one in second if one.readable.parameters.kind != SignatureKind.MATERIAL]
    if second and trackings == {"normal_displacement"}:
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
        *(p.components, p.reference == sequence.MEAN),
    )


def readable_of(signatures: Sequence[ModalSignature]) -> model.Readable:
    """Describe what signatures of one basis share: their common first modes."""
    first = signatures[0]
    parameters = replace(
        first.parameters,
        modes=min(spring_modes.common_count(signature.modes) for signature in signatures),
        template=None,
        landmarks=template.GivenLandmarks(),
        reference=sequence.MEAN if first.parameters.reference == sequence.MEAN else 0,
    )
    n = int(parameters.modes or 0)
    return model.Readable(first.surface, n, first.modes.connectivity_id, parameters)


class Alike(NamedTuple):
    """Cases whose signatures compare, the numbers they were given by, and those left out."""

    cases: tuple[TrainingCase, ...]
    numbers: tuple[int, ...]
    left_out: tuple[LeftOut, ...]
    notes: tuple[Note, ...] = ()

    @property
    def signatures(self) -> list[ModalSignature]:
        """Signatures of the cases."""
        return [case.signature for case in self.cases]

    def commonest(self) -> "Alike":
        """Keep the cases of the commonest basis; leave the others out."""
        bases = list(map(basis_of, self.signatures))
        most = Counter(bases).most_common(1)[0][0] if bases else None
        rows = list(zip(self.cases, self.numbers, bases, strict=True))
        odd = [
            LeftOut(
                case.name or f"case {number}",
                f"Its {len(case.signature.modes)} modes of a {case.signature.surface} are not "
                "comparable with those of most cases.",
            )
            for case, number, basis in rows
            if basis != most
        ]
        kept = [(case, number) for case, number, basis in rows if basis == most]
        cases, numbers = zip(*kept, strict=True) if kept else ((), ())
        return Alike(cases, numbers, (*self.left_out, *odd), self.notes)


def alike(
    cases: Iterable[AnyCase],
    parameters: SignatureParameters,
    fewer: Sequence[int] = (),
    *,
    leaves_out: bool = False,
    progress: Reporter | None = None,
) -> list[Alike]:
    """Read cases in each basis that they share.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
        Sequences are fitted. They may be read several times.
    parameters : SignatureParameters
    fewer : sequence of int
        As in `TrainingCase.fitted`.
    leaves_out : bool
        Whether to go on without cases that cannot be used, in the basis of most.
    progress : callable, optional
        Called with the number of cases read, in each basis anew, and of all as far as known.

    Raises
    ------
    UnlikeCasesError
        If there is no such basis.
    ParameterError
        If a signature cannot be used.
    ModalMotionError
        If a case cannot be read or fitted.
    """
    cohort = list(cases) if iter(cases) is cases else cases

    def read_in(basis: SignatureParameters) -> Alike:
        return _read(cohort, basis, fewer, leaves_out=leaves_out, progress=progress)

    read = read_in(parameters)
    kept = read.commonest()
    if len(kept.cases) == len(read.cases):
        return [read]
    counts = Counter(signature.surface for signature in read.signatures)
    surfaces = [surface for surface, _ in counts.most_common()]
    found = [kept] if leaves_out else []
    if parameters.topology is None and len(surfaces) > 1:
        for name in (*(surface for surface in surfaces if surface != MESH), MESH):
            try:
                other = read_in(replace(parameters, topology=name))
            except errors.ModalMotionError:
                continue
            most = other.commonest()
            if leaves_out or len(most.cases) == len(other.cases):
                basis = most.signatures[0].surface
                note = Note.of("topology_imposed", shapes=" or ".join(surfaces), basis=basis)
                found.append(most._replace(notes=(note,)))
    if not found:
        odd = kept.left_out
        names = ", ".join(case.name for case in odd[:_MOST_NAMED])
        names += ", and others" if len(odd) > _MOST_NAMED else ""
        raise errors.UnlikeCasesError(
            f"The recordings are not comparable: {len(odd)} have other modes than most ({names}). "
            f"{odd[0].reason}",
            remedy="Leave them out (--skip-unreadable, on_error = 'leave out'), state one topology "
            "for all, such as topology = sphere (--topology sphere), or give the sequences "
            "themselves, which are then fitted in one basis.",
            details={"left_out": [case.name for case in odd[:20]]},
        )
    fewest = min(len(one.left_out) for one in found)
    return [one for one in found if len(one.left_out) == fewest]


def _read(
    cases: Iterable[AnyCase],
    parameters: SignatureParameters,
    fewer: Sequence[int],
    *,
    leaves_out: bool,
    progress: Reporter | None,
) -> Alike:
    """Read cases wherever joblib works, in their order."""
    from joblib import Parallel, delayed

    numbered, n_cases = enumerate(cases), length_hint(cases)
    pieces = iter(lambda: tuple(itertools.islice(numbered, _IN_ONE_PIECE)), ())
    works = (delayed(_read_piece)(piece, parameters, fewer, leaves_out) for piece in pieces)
    results = Parallel(return_as="generator", batch_size=1)(works)
    kept: dict[int, TrainingCase] = {}
    left_out: list[LeftOut] = []
    read = itertools.chain.from_iterable(results)
    for number, case in enumerate(reported(read, progress, n_cases)):
        if isinstance(case, LeftOut):
            left_out.append(case)
        else:
            kept[number] = case
    return Alike(tuple(kept.values()), tuple(kept), tuple(left_out))


def _read_piece(
    piece: tuple[tuple[int, AnyCase], ...],
    parameters: SignatureParameters,
    fewer: Sequence[int],
    leaves_out: bool,
) -> list[TrainingCase | LeftOut]:
    results: list[TrainingCase | LeftOut] = []
    for number, source in piece:
        called = source.name or f"case {number}"
        try:
            read = source if isinstance(source, TrainingCase) else source.read()
            case = read.fitted(parameters, fewer)
            _require_usable(case.signature, called)
        except UNUSABLE as error:
            if not leaves_out:
                raise
            results.append(LeftOut.of(error, called))
        else:
            results.append(case)
    return results


def _require_usable(signature: ModalSignature, called: str) -> None:
    s, fault, remedy = signature, "", "Leave it out."
    if s.n_frames < 2:
        fault = "has only one frame, which shows no motion"
    elif s.parameters.components != body_frame.Components.CARTESIAN:
        fault, remedy = "has no Cartesian amplitudes", "Fit it with components = cartesian."
    elif not s.modes.length_of(s.lengths, s.angular_frequencies, 1.0) > 0.0:
        fault, remedy = "has no extent in its reference frame", "Choose another reference."
    if fault:
        raise errors.ParameterError(
            f"{called} {fault}.", remedy=remedy, details={"sequence_id": s.sequence_id}
        )


def _cohort(read: Alike, options: TrainingOptions) -> Cohort:
    rows: dict[str, tuple[int, TrainingCase]] = {}
    for number, case in zip(read.numbers, read.cases, strict=True):
        called = case.name or f"case {number}"
        if not str(case.label or "").strip():
            raise errors.ParameterError(
                f"{called} has no label.",
                remedy="Give every case its class.",
                details={"case": number},
            )
        first = rows.setdefault(case.sequence_id, (number, case))[1]
        if first.label != case.label:
            raise errors.ParameterError(
                f"{called} has two classes, {first.label!r} and {case.label!r}"
                + (f" (as {first.name})." if first.name not in ("", called) else "."),
                remedy="Give each recording one class.",
                details={"case": number, "sequence_id": case.sequence_id},
            )
    numbers, cases = zip(*rows.values(), strict=True) if rows else ((), ())
    classes = tuple(sorted({case.label for case in cases}))
    if len(classes) < 2:
        without = f", without the {len(read.left_out)} that were left out" if read.left_out else ""
        raise errors.ParameterError(
            f"The training cases have {len(classes)} class(es){without}.",
            remedy="Give cases of at least two classes.",
            details={"classes": list(classes), "left_out": [str(c) for c in read.left_out[:20]]},
        )
    readable = readable_of([case.signature for case in cases])
    signatures = [first_modes(case.signature, readable.n_modes) for case in cases]
    motions = tuple(map(Motion, signatures))
    subjects, groups = _grouped(cases, options.groups)
    n_same, most = len(read.cases) - len(cases), options.signature_parameters.modes or 0
    notes = [*left_out_notes(read.left_out), *read.notes]
    if n_same:
        notes.append(Note.of("cases_repeated", n_cases=n_same))
    if options.modes is None and readable.n_modes < most:
        notes.append(Note.of("modes_shared", most=most, n_modes=readable.n_modes))
    return Cohort(
        readable=readable,
        motions=motions,
        classes=classes,
        y=np.array([classes.index(case.label) for case in cases]),
        groups=groups,
        subjects=subjects,
        sequence_ids=tuple(case.sequence_id for case in cases),
        names=tuple(case.name for case in cases),
        conditions=tuple(map(conditions_of, signatures)),
        numbers=np.array(numbers),
        n_given=len(read.cases) + len(read.left_out),
        walls=motion_features.states_walls(motions),
        notes=(*notes, *caveats.cohort_notes(cases, [motion.log_size for motion in motions])),
    )


def _grouped(cases: Sequence[TrainingCase], by: str | None) -> tuple[tuple[str, ...], Ints]:
    """Subjects, and groups of cases that share a subject or a covariate."""
    subjects = tuple(case.subject or f"sequence {case.sequence_id}" for case in cases)
    keys = [*subjects, *(() if by is None else _values_of(by, cases))]
    place = np.unique(keys, return_inverse=True)[1] + len(cases)
    rows = np.arange(len(keys)) % len(cases)
    n = len(cases) + len(keys)
    links = scipy.sparse.coo_array((np.ones(len(keys)), (rows, place)), (n, n))
    groups = scipy.sparse.csgraph.connected_components(links, directed=False)[1][: len(cases)]
    return subjects, np.unique(groups, return_inverse=True)[1]


def _values_of(column: str, cases: Sequence[TrainingCase]) -> Iterator[str]:
    """Give a covariate of each case as text; what is unknown is of a value of its own."""
    stated = [{k.casefold(): v for k, v in case.covariates.items()} for case in cases]
    known = sorted({name for case in cases for name in case.covariates})
    if column.casefold() not in map(str.casefold, known):
        raise errors.ParameterError(
            f"The option 'groups' names the covariate {column[:80]!r}, which none of the cases "
            "has.",
            remedy="Use a column of the manifest or a covariate of the cases: "
            f"{', '.join(known) or 'there is none'}.",
            details={"option": "groups", "covariates": known},
        )
    for number, values in enumerate(stated):
        # Other than any subject.
        yield f"\0{values.get(column.casefold(), f'unknown {number}')}"
