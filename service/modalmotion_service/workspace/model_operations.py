"""Operations on models, norms and tables of features: made, tested, asked."""

import asyncio
import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from modalmotion.classification import TrainingOptions
from modalmotion.classification.cases import LeftOut
from modalmotion.classification.evaluation import CaseAnswer
from modalmotion.errors import (
    NotFoundError,
    ParameterError,
    TopologyError,
    UnlikeCasesError,
)
from modalmotion.mesh.facts import Facts
from modalmotion.norm import Norm, norm_from_hdf5
from modalmotion.norm.norm import parameters_of_controls
from modalmotion.progress import Progress, Reporter, part_of, silent
from modalmotion.signature.making import SignatureParameters
from modalmotion_service.errors import ConflictError
from modalmotion_service.http.negotiation import CSV, JSON, PNG, attachment
from modalmotion_service.schemas import queries
from modalmotion_service.work.tasks import classification
from modalmotion_service.work.tasks.files import Fitted
from modalmotion_service.workspace import models
from modalmotion_service.workspace.analysis import in_one_basis
from modalmotion_service.workspace.operation import Case, Outcome, Request, State, operation
from modalmotion_service.workspace.training import case_file, fit_each, read_cases, train

# Parts of the progress that classifications and signatures are counted as.
_CLASSIFYING: Final = 0.95
_FITTING: Final = 0.8


@operation(query=queries.TRAINING, is_job=True, is_apart=True)
async def training(state: State, request: Request, report: Reporter) -> Outcome:
    """Train a model on the cases of a file."""
    cases = await asyncio.to_thread(read_cases, state.spool.at(request.file))
    options = request.query.options()
    record = await train(state, request.file, request.reference, options, cases, report)
    return Outcome(b"", link=f"/v1/models/{record.name}@{record.version}")


@operation(PNG)
async def model_view(state: State, request: Request, _: Reporter) -> Outcome:
    """Draw confusion matrix and calibration curve of a model's card."""
    model = await asyncio.to_thread(models.choose, state, request.reference)
    content, _versions = await asyncio.to_thread(models.describe, state, model)
    title = str(content.record.reference)
    return Outcome(await state.analysis.work(classification.draw_card, content.card, title), PNG)


@operation(CSV)
async def held_out(state: State, request: Request, _: Reporter) -> Outcome:
    """Give a model's answers to its training cases, each held out.

    Subjects are those stored with the sequences now; of a deleted one its number.
    """
    model = await asyncio.to_thread(models.choose, state, request.reference)
    ids = await state.analysis.work(classification.held_out_ids, model.source)
    known = await asyncio.to_thread(state.store.sequence_records, ids)
    subjects = {id_: one.subject for id_, one in known.items() if one.subject is not None}
    table = await state.analysis.work(classification.held_out_table, model.source, subjects)
    if not table:
        raise NotFoundError(
            f"The model {model.name}@{model.version} has no held-out answers: it was not "
            "cross-validated, or its file does not contain them.",
            remedy="Train it again, or test it on other sequences: POST .../evaluations.",
        )
    return Outcome(table, CSV, headers=attachment(f"{model.name}-{model.version}.csv"))


def require_known_classes(cases: Sequence[Case], model: models.ChosenModel) -> None:
    """Check that there are cases, and that a model knows the classes of all.

    Raises
    ------
    ParameterError
        If not; it names the sequences.
    """
    if not cases:
        raise ParameterError("There is no sequence to test on.", remedy="Name at least one.")
    unknown = [case for case in cases if case.label not in model.classes]
    if unknown:
        more = f" and {len(unknown) - 1} more like it" if len(unknown) > 1 else ""
        raise ParameterError(
            f"The model {model.name!r} does not know the class {unknown[0].label[:80]!r} of the "
            f"sequence {unknown[0].id[:12]}{more}.",
            remedy=f"Name sequences of its classes: {', '.join(model.classes)}.",
            details={"sequence_ids": [case.id for case in unknown[:20]]},
        )


@operation(JSON, CSV, PNG, query=queries.EvaluationOptions)
async def evaluation(state: State, request: Request, report: Reporter) -> Outcome:
    """Test a model, or two beside each other, on labelled sequences.

    The classifications of the sequences are stored on the way.
    """
    query, kind = request.query, request.media_type
    names = [one for one in (request.reference, query.compare_with) if one is not None]
    chosen = [await asyncio.to_thread(models.choose, state, name) for name in names]

    async def answered(case: Case) -> list[CaseAnswer]:
        return [await _answer(state, case, model, query.coverage) for model in chosen]

    tell = part_of(report, 0.0, _CLASSIFYING)
    by_case = await state.analysis.each(request.cases, answered, tell, "sequence")
    report(Progress(_CLASSIFYING, stage="figures"))
    answers = [list(its) for its in zip(*by_case, strict=True)]
    sources, versions = [one.source for one in chosen], [one.version for one in chosen]
    body = await state.analysis.work(
        classification.measure, sources, versions, answers, query.coverage, kind
    )
    return Outcome(body, kind)


async def _answer(
    state: State, case: Case, model: models.ChosenModel, coverage: float
) -> CaseAnswer:
    kept, _ = await models.classification(state, case.id, model, coverage)
    return CaseAnswer(
        name="",
        sequence_id=case.id,
        subject=case.subject or f"sequence {case.id}",
        truth=case.label,
        answer=kept.result.label,
        probabilities=tuple(kept.result.probabilities.tolist()),
        class_set=kept.result.class_set,
        flags=kept.result.flags,
    )


def require_free_norm(state: State, name: str) -> None:
    """Check that no norm has this name.

    Raises
    ------
    ConflictError
        If one has.
    """
    if name in state.store.norms():
        raise ConflictError(
            f"There is a norm named {name!r}.",
            remedy=f"Choose another name, or DELETE /v1/norms/{name} first.",
            details={"norm": name},
        )


@operation(query=queries.NormOptions, is_job=True)
async def norm(state: State, request: Request, report: Reporter) -> Outcome:
    """Make a norm of stored controls, and keep it."""
    query, cases, analysis = request.query, request.cases, state.analysis
    own = TrainingOptions(modes=query.modes, topology=query.topology).signature_parameters
    parameters = parameters_of_controls(own, [_facts(state, case) for case in cases])

    tell = part_of(report, _FITTING, 1.0)

    async def make_with(wanted: SignatureParameters) -> Norm:
        controls = await _recordings(state, cases, wanted, report)
        with analysis.image() as image:
            await analysis.followed(
                *(tell, classification.make_norm, controls),
                *(query.name, query.modes, query.topology, image),
            )
            made = await asyncio.to_thread(norm_from_hdf5, image)
            await asyncio.to_thread(state.store.put_norm, made)
            return made

    try:
        made = await in_one_basis(make_with, parameters)
    except ParameterError as error:
        if "norm" not in error.details:
            raise
        raise ConflictError(error.message, remedy=error.remedy, details=error.details) from error
    return Outcome(b"", link=f"/v1/norms/{made.name}")


@operation(query=queries.DeviationOptions)
async def deviations(state: State, request: Request, report: Reporter) -> Outcome:
    """Compare stored sequences with a norm, each, and from five on together."""
    cases, store = request.cases, state.store
    kept = await asyncio.to_thread(store.norm, request.reference)
    path = store.norm_path(request.reference)
    parameters: SignatureParameters = kept.readable.parameters
    recordings = await _recordings(state, cases, parameters, report)
    stated = [store.sequence_record(case.id).topology for case in cases]

    async def ask() -> tuple[bytes, dict[int, str]]:
        level, task = request.query.level, classification.ask_norm
        return await state.analysis.work(task, recordings, path, level, stated)

    answer, imposed = await ask()
    if imposed:
        # As `fitted_in` does it where a sequence is at hand.
        for number, topology in imposed.items():
            with contextlib.suppress(TopologyError):
                wanted = replace(parameters, topology=topology)
                (recordings[number],) = await _recordings(state, [cases[number]], wanted)
            stated[number] = topology
        answer, _ = await ask()
    return Outcome(answer)


def _facts(state: State, case: Case) -> Facts:
    facts: Facts = state.store.sequence_record(case.id).facts
    return replace(facts, covariates=case.covariates)


async def _recordings(
    state: State, cases: Sequence[Case], parameters: SignatureParameters, report: Reporter = silent
) -> list[Fitted]:
    recordings, paths = [], await fit_each(state, cases, parameters, report, _FITTING)
    for case, path in zip(cases, paths, strict=True):
        assert isinstance(path, Path)  # noqa: S101 (none is left out)
        record, vertices = state.store.sequence_record(case.id), path
        if record.has_upload:
            vertices = await asyncio.to_thread(state.store.sequence_path, case.id)
        record = replace(record, facts=_facts(state, case), subject=case.subject)
        recordings.append(Fitted(path, vertices, None, None, record))
    return recordings


@operation(JSON, CSV, query=queries.FeatureOptions)
async def features(state: State, request: Request, report: Reporter) -> Outcome:
    """Write the features of many sequences as a table."""
    options, kind = request.query.options(), request.media_type
    leaves_out = request.query.on_error == "leave out"
    own = TrainingOptions(modes=options["modes"], topology=options["topology"]).signature_parameters

    async def make(asked: SignatureParameters, on_error: str = "raise") -> Outcome:
        # Spring modes are those of all, or of none.
        is_own = asked.topology == own.topology
        paths = await fit_each(
            *(state, request.cases, asked, report, _FITTING), leaves_out=leaves_out and is_own
        )
        report(Progress(_FITTING, stage="features"))
        pairs = zip(request.cases, paths, strict=True)
        files = [case_file(case, path) for case, path in pairs if isinstance(path, Path)]
        left_out = [path for path in paths if isinstance(path, LeftOut)]
        task = classification.tabulate_features
        with state.analysis.output() as output:
            n = await state.analysis.work(task, files, options, on_error, left_out, kind, output)
        return Outcome(output, kind, headers={"Cases-Left-Out": str(n)})

    try:
        return await in_one_basis(make, own)
    except UnlikeCasesError:
        if not leaves_out:
            raise
        return await make(own, "leave out")
