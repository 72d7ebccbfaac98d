"""Training of models: labelled sequences, looked up and checked, their signatures, the model."""

import asyncio
import contextlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from pydantic import TypeAdapter

from modalmotion import classification, mesh
from modalmotion.classification import model_files
from modalmotion.classification.cases import UNUSABLE, LeftOut, case_name
from modalmotion.classification.options import FEWER_MODES, OnError
from modalmotion.errors import (
    LimitError,
    ModalMotionError,
    ModeCountError,
    NotFoundError,
    ParameterError,
    StoreError,
    named,
)
from modalmotion.modes.topologies import MESH
from modalmotion.progress import Reporter, part_of
from modalmotion.signature.making import SignatureKind, SignatureParameters
from modalmotion.store import ModelRecord, ResultStore, disk, folders
from modalmotion_service.errors import CostError
from modalmotion_service.schemas.queries import LabelledSequence
from modalmotion_service.work.tasks.training import Cases, Unfitted, train_model
from modalmotion_service.workspace import analysis, spool
from modalmotion_service.workspace.operation import Case, State

_CASES: Final = TypeAdapter(list[Case])

# Of each class: one to learn from and one to test on.
LEAST_PER_CLASS: Final = 2

# Ids that an error names; a client that got everything wrong knows it from these.
_NAMED: Final = 20


def look_up(store: ResultStore, sequences: Sequence[LabelledSequence], most: int) -> list[Case]:
    """Find what is known of each sequence, and check that a model can be trained on them.

    Raises
    ------
    LimitError, NotFoundError, ParameterError
        As of `labelled_cases`; or if there are too few of a class, or of classes; it names them.
    """
    cases = labelled_cases(store, sequences, most, "training_sequences")
    per_class = Counter(case.label for case in cases)
    if len(per_class) < 2:
        only = f"only {next(iter(per_class))!r}" if per_class else "no sequence"
        raise ParameterError(
            f"A model needs at least two classes; there is {only}.",
            remedy="Name sequences of two or more classes.",
            details={"classes": dict(per_class)},
        )
    few = [case.id for case in cases if per_class[case.label] < LEAST_PER_CLASS]
    if few:
        raise _about_ids(
            *(ParameterError, few, f"of a class with fewer than {LEAST_PER_CLASS}"),
            f"Name {LEAST_PER_CLASS} or more of each class, ten or more for class sets that rule "
            "anything out; or leave the class out.",
            classes=dict(per_class),
            least=LEAST_PER_CLASS,
        )
    return cases


def labelled_cases(
    store: ResultStore, sequences: Sequence[LabelledSequence], most: int, limit: str = "query_ids"
) -> list[Case]:
    """Find what is known of each sequence as `find_cases` does, and check that all have a label.

    Raises
    ------
    LimitError, NotFoundError, ParameterError
        As of `find_cases`; or if some have no label; it names them.
    """
    cases = find_cases(store, sequences, most, limit)
    unlabelled = [case.id for case in cases if not case.label]
    if unlabelled:
        raise _about_ids(
            *(ParameterError, unlabelled, "without a label"),
            'State it here, as {"id": ..., "label": ...}, or with PATCH /v1/sequences/{id}.',
        )
    return cases


def find_cases(
    store: ResultStore, sequences: Sequence[LabelledSequence], most: int, limit: str = "query_ids"
) -> list[Case]:
    """Find what is known of each sequence; the label is empty if there is none.

    Parameters
    ----------
    store : ResultStore
    sequences : sequence of LabelledSequence
    most : int
        Sequences that may be named.
    limit : str
        Name of that limit.

    Raises
    ------
    LimitError
        If there are more than `most`.
    NotFoundError
        If some are not kept; it names them.
    ParameterError
        If some are named twice, or a covariate cannot be one; it names them.
    """
    if len(sequences) > most:
        raise LimitError(
            f"{len(sequences)} sequences are named; the limit is {most}.",
            remedy="Name fewer, or have the limit raised.",
            limit=limit,
            details={"most": most},
        )
    repeated = [name for name, n in Counter(case.id for case in sequences).items() if n > 1]
    if repeated:
        remedy = "Name each sequence once: repeated, it would be on both sides of a split."
        raise _about_ids(ParameterError, repeated, "named more than once", remedy)
    cases, records = [], store.sequence_records(case.id for case in sequences)
    unknown = [case.id for case in sequences if case.id not in records]
    if unknown:
        remedy = "Send them first, or leave them out."
        raise _about_ids(NotFoundError, unknown, "not kept here", remedy)
    for case in sequences:
        record = records[case.id]
        label, subject = case.label or record.label or "", case.subject or record.subject
        stated = mesh.Facts(covariates=case.covariates or {}).over(record.facts)
        cases.append(Case(case.id, label, subject, dict(stated.covariates)))
        folders.require_name("label", label or None)
        folders.require_name("subject", subject)
    return cases


def write_cases(file: spool.SpoolFile, cases: list[Case]) -> None:
    """Note the cases of a training durably, for its job to read.

    Raises
    ------
    StoreError
        If they cannot be written.
    """
    try:
        file.path.write_bytes(_CASES.dump_json(cases))
    except OSError as error:
        raise disk.cannot_write(file.path, error) from error
    file.make_durable()


def read_cases(file: Path) -> list[Case]:
    """Read what `write_cases` wrote."""
    return _CASES.validate_json(file.read_bytes())


def _about_ids(
    kind: type[ModalMotionError], ids: list[str], what: str, remedy: str, **details: object
) -> ModalMotionError:
    """Make an error about sequences, of which it names the first."""
    count = "1 sequence is" if len(ids) == 1 else f"{len(ids)} sequences are"
    more = f" and {len(ids) - 3} more" if len(ids) > 3 else ""
    some = ", ".join(one[:12] for one in ids[:3]) + more
    details |= {"sequence_ids": ids[:_NAMED], "n_sequences": len(ids)}
    return kind(f"{count} {what}: {some}.", remedy=remedy, details=details)


# Share of a training's progress that fitting the signatures is counted as.
_FITTING: Final = 0.5


async def train(
    state: State,
    training: str,
    name: str,
    options: classification.TrainingOptions,
    cases: list[Case],
    report: Reporter,
) -> ModelRecord:
    """Train a model and keep it as the next version of its name.

    Parameters
    ----------
    state : State
    training : str
        Name of this training: begun again after a crash, it makes one version.
    name : str
    options : TrainingOptions
    cases : list of Case
    report : Reporter

    Raises
    ------
    ModalMotionError
        If a sequence was deleted or cannot be fitted, or no model can be trained on them.
    """
    known = await asyncio.to_thread(state.store.model_of_training, training)
    if known is not None:
        return known
    parameters = options.signature_parameters
    image, other = state.spool.new_path(), state.spool.new_path()
    trainer = replace(state.analysis, engine=state.training_engine)
    leaves_out = options.on_error == OnError.LEAVE_OUT
    weighs_kinds = options.kind is None and await asyncio.to_thread(_may_slide, state, cases)

    async def train_with(asked: SignatureParameters, image: Path) -> int:
        paths = await fit_each(state, cases, asked, report, _FITTING, leaves_out=leaves_out)
        along_normals: list[Path | LeftOut] | None = None
        if weighs_kinds:
            # Curves and volumes have none.
            with contextlib.suppress(ModalMotionError):
                other = replace(asked, kind=SignatureKind.NORMAL_DISPLACEMENT)
                found = await fit_each(state, cases, other, report, _FITTING, leaves_out=leaves_out)
                # What lacks one of them has neither.
                both = list(zip(paths, found, strict=True))
                paths = [two if isinstance(two, LeftOut) else one for one, two in both]
                along_normals = [one if isinstance(one, LeftOut) else two for one, two in both]

        tell = part_of(report, _FITTING, 1.0)
        own = _cases(cases, paths), along_normals and _cases(cases, along_normals)
        settings = state.settings
        try:
            return await trainer.followed(
                *(tell, train_model, *own, name, options.as_json(), training, image),
                *(settings.scheduler, settings.workers),
            )
        except ModalMotionError as error:
            raise _about(state, error, error.details.get("sequence_id")) from error

    async def train_with_most(asked: SignatureParameters) -> tuple[SignatureParameters, int]:
        # As many modes as every recording can tell apart.
        for modes in FEWER_MODES if options.modes is None else ():
            try:
                return asked, await train_with(asked, image)
            except ModeCountError:
                asked = replace(asked, modes=modes)
        return asked, await train_with(asked, image)

    try:
        made, n_kept = await analysis.in_one_basis(train_with_most, parameters)
        is_own = options.topology is None and made.closed_form == parameters.closed_form
        if leaves_out and is_own and n_kept < len(cases):
            # Spring modes are taken where they leave fewer out.
            with contextlib.suppress(ParameterError):
                if await train_with(replace(parameters, topology=MESH), other) > n_kept:
                    image, other = other, image
        model = await asyncio.to_thread(model_files.read_kept_model, image)
        return await asyncio.to_thread(state.store.put_model, model)
    finally:
        for path in (image, other):
            spool.remove_with_beside(path)


def _may_slide(state: State, cases: list[Case]) -> bool:
    """Whether some recordings do not state that their points follow the tissue."""
    records = (state.store.sequence_record(case.id) for case in cases)
    return any(str(record.facts.tracking) != SignatureKind.MATERIAL for record in records)


async def fit_each(
    state: State,
    cases: Sequence[Case],
    parameters: SignatureParameters,
    report: Reporter,
    share: float,
    *,
    leaves_out: bool = False,
) -> list[Path | LeftOut]:
    """Signatures of all cases: stored ones, and the rest made by workers.

    Parameters
    ----------
    state : State
    cases : sequence of Case
    parameters : SignatureParameters
    report : callable
    share : float
        Of the whole progress, which they are counted as.
    leaves_out : bool
        Whether what cannot be fitted is given with the reason, and the rest fitted.

    Raises
    ------
    ModalMotionError
        Of the first that cannot be; it names the sequence.
    """

    async def fitted(case: Case) -> Path | LeftOut:
        try:
            return await state.analysis.signature(case.id, parameters)
        except ModalMotionError as error:
            about = _about(state, error, case.id)
            if leaves_out and isinstance(about, (*UNUSABLE, CostError)):
                return LeftOut.of(about, case_name(case.id))
            raise about from error

    return await state.analysis.each(cases, fitted, part_of(report, 0.0, share), "signature")


def _about(state: State, error: ModalMotionError, sequence_id: object) -> ModalMotionError:
    """Say which sequence an error is about, where it is about one."""
    if not isinstance(sequence_id, str):
        return error
    # A result may be missing for other reasons than that its sequence was deleted.
    if isinstance(error, StoreError) and not state.store.has_sequence(sequence_id):
        return NotFoundError(
            f"Sequence {sequence_id[:12]} was deleted during this work.",
            remedy="Start it again without this sequence.",
            details={"sequence_id": sequence_id},
        )
    about = named(error, case_name(sequence_id), sequence_id=sequence_id)
    about.remedy = f"{error.remedy} Or leave this sequence out.".strip()
    return about


def _cases(cases: list[Case], paths: list[Path | LeftOut]) -> Cases:
    return [
        Unfitted(case_name(case.id), path.reason)
        if isinstance(path, LeftOut)
        else case_file(case, path)
        for case, path in zip(cases, paths, strict=True)
    ]


def case_file(case: Case, path: Path) -> classification.CaseFile:
    """Give a case with the file of its signature."""
    return classification.CaseFile(path, case.id, case.label, case.subject, dict(case.covariates))
