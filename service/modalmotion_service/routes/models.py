"""Models and norms: made of stored sequences, listed, described, tested, asked, deleted."""

import asyncio
from dataclasses import replace
from typing import Annotated

from fastapi import Depends, Query, Response

from modalmotion import errors, store
from modalmotion.classification import ModelCard, available_models, card_markdown
from modalmotion_service.http.gated_router import GatedRouter, body_of
from modalmotion_service.http.negotiation import CSV, HDF5, JSON, MARKDOWN, PNG, attachment
from modalmotion_service.routes.asked import AskedAny, AskedNow, IdempotencyKey, answers, page_of
from modalmotion_service.schemas import models as results
from modalmotion_service.schemas import queries
from modalmotion_service.schemas.from_core import ModelName, ModelReference, Paging
from modalmotion_service.workspace import model_operations as operations
from modalmotion_service.workspace import models, operation, spool
from modalmotion_service.workspace.training import labelled_cases, look_up, write_cases

router = GatedRouter(prefix="/v1/models", tags=["models"])


@router.post("", **answers(status=202))
async def train_model(
    wanted: Annotated[queries.TrainingRequest, Depends(body_of(queries.TrainingRequest))],
    asked: AskedNow,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Train a model on stored, labelled sequences, as the next version of its name.

    Always a job, whose result links to the new version. Missing signatures are fitted on the way.
    Labels and subjects are those at the time of the request.
    """
    state = asked.state

    async def make() -> Response:
        name = store.require_model_name(wanted.name)
        models.require_own(name, "takes no further versions", "Choose another name.")
        wanted.options.options()  # refused at once where one is out of range
        most = state.settings.max_training_sequences
        # Up to a hundred thousand sequences: others are answered meanwhile.
        cases = await asyncio.to_thread(lambda: look_up(state.store, wanted.cases, most))
        with spool.SpoolFile(state.spool.new_path()) as file:
            await asyncio.to_thread(write_cases, file, cases)
            request = operation.Request(query=wanted.options, reference=name)
            return await asked.do(operations.training, request, file=file)

    said = operation.Request(query=wanted)
    return await asked.once(idempotency_key, operations.training, said, None, make)


@router.get("")
def list_models(query: Annotated[Paging, Query()], asked: AskedNow) -> results.ModelPageAnswer:
    """List models by name, including shipped ones, each with its newest version."""
    records = models.records(asked.state)
    page, cursor = page_of(sorted(records), query.limit, query.cursor)
    return results.ModelPageAnswer(models=[_summary(records[name]) for name in page], cursor=cursor)


@router.get("/{name}", **answers(JSON, PNG, HDF5, CSV, MARKDOWN, of=results.ModelAnswer))
async def describe_model(name: ModelReference, asked: AskedAny) -> Response:
    """Describe a model, in its newest version or name@version.

    Its card, as data (JSON), a picture, or a page (Markdown); the model itself (HDF5); or the
    held-out answers of its training by case (CSV).
    """
    state = asked.state
    model = await asyncio.to_thread(models.choose, state, name)
    kind = asked.media_type(JSON, PNG, HDF5, CSV, MARKDOWN)
    content, versions = await asyncio.to_thread(models.describe, state, model)
    parts = (model.id, str(model.version), repr(versions))
    if kind in (PNG, CSV):
        what = operations.model_view if kind == PNG else operations.held_out
        request = operation.Request(media_type=kind, reference=f"{model.name}@{model.version}")
        # Subjects in a table may change.
        return await asked.do(what, request, tag=parts if kind == PNG else None)
    tag = asked.tagged(*parts, kind)
    if (known := asked.knows(tag)) is not None:
        return known
    headers = {"ETag": tag, "Vary": "Accept"}
    if kind == HDF5:
        headers |= attachment(f"{model.name}-{model.version}.h5")
        return Response(await asyncio.to_thread(store.model_to_hdf5, content), 200, headers, HDF5)
    if kind == MARKDOWN:
        card = ModelCard.from_json(content.card)
        page = card_markdown(f"{model.name}@{model.version}", model.id, card, head=True)
        return Response(page, 200, headers, f"{MARKDOWN}; charset=utf-8")
    source = model.source
    file = None if isinstance(source, str) else source.relative_to(state.store.root).as_posix()
    answer = results.ModelAnswer.with_card(content, versions, file)
    return Response(answer.model_dump_json(), 200, headers, JSON)


@router.delete("/{name}", status_code=204)
async def delete_model(name: ModelReference, asked: AskedNow) -> None:
    """Delete a version of a model, as name@version.

    Its number is not used again, and its classifications stay.
    """
    reference = store.parse_reference(name)
    if reference.version is None:
        raise errors.ParameterError(
            "No version of the model is named.", remedy=f"Name one, such as {name}@1."
        )
    if reference.name in available_models():
        models.choose(asked.state, name)  # or there is no such version of it
    why = "cannot be deleted", "Leave it; no request has to use it."
    models.require_own(reference.name, *why)
    await asyncio.to_thread(asked.store.delete_model, reference.name, reference.version)


@router.post(
    "/{name}/evaluations",
    **answers(JSON, CSV, PNG, of=results.EvaluationAnswer | results.ComparisonAnswer),
)
async def evaluate_model(
    name: ModelReference,
    wanted: Annotated[queries.EvaluationRequest, Depends(body_of(queries.EvaluationRequest))],
    asked: AskedAny,
) -> Response:
    """Test a model on stored, labelled sequences, or two on the same.

    Missing classifications are made on the way and stored. Test on subjects that it was not trained
    on: a note says where it was. With `compare_with` the answer has differences of accuracy, AUC,
    log loss and Brier score, with intervals from paired resamples of the subjects.
    """
    kind = asked.media_type(JSON) if wanted.compare_with else ""
    names = [one for one in (name, wanted.compare_with) if one is not None]
    chosen = [await asyncio.to_thread(models.choose, asked.state, one) for one in names]
    request = await asked.about(wanted, queries.EvaluationOptions, labelled_cases, media_type=kind)
    for model in chosen:
        operations.require_known_classes(request.cases, model)
    # By their versions: newer ones may exist when the job is resumed.
    first, *others = (str(model.reference) for model in chosen)
    options = request.query.model_copy(update={"compare_with": others[0] if others else None})
    return await asked.do(operations.evaluation, replace(request, query=options, reference=first))


def _summary(records: list[store.ModelRecord]) -> results.ModelSummary:
    return results.ModelSummary.of(records[-1], [record.version for record in records])


of_norms = GatedRouter(prefix="/v1/norms", tags=["norms"])


@of_norms.post("", **answers(status=202))
async def make_norm(
    wanted: Annotated[queries.NormRequest, Depends(body_of(queries.NormRequest))],
    asked: AskedNow,
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Make a norm of stored recordings of people who are taken as usual, one of each.

    Always a job, whose result links to the norm. Missing signatures are fitted on the way.
    Subjects and covariates are those at the time of the request. The norm contains features of the
    controls, and stays when they are deleted.
    """

    async def make() -> Response:
        name = store.require_model_name(wanted.name)
        await asyncio.to_thread(operations.require_free_norm, asked.state, name)
        return await asked.do(operations.norm, await asked.about(wanted, queries.NormOptions))

    said = operation.Request(query=wanted)
    return await asked.once(idempotency_key, operations.norm, said, None, make)


@of_norms.get("")
async def list_norms(query: Annotated[Paging, Query()], asked: AskedNow) -> results.NormPageAnswer:
    """List norms by name, a page at a time."""
    names = await asyncio.to_thread(asked.store.norms)
    page, cursor = page_of(list(names), query.limit, query.cursor)
    links = [results.NormLink(name=name, links={"self": f"/v1/norms/{name}"}) for name in page]
    return results.NormPageAnswer(norms=links, cursor=cursor)


@of_norms.get("/{name}", **answers(JSON, HDF5, of=results.NormAnswer, waits=False))
async def describe_norm(name: ModelName, asked: AskedNow) -> Response:
    """Describe a norm; or give its file, which `modalmotion norm ask` reads."""
    kind = asked.media_type(JSON, HDF5)
    norm = await asyncio.to_thread(asked.store.norm, name)
    tag = asked.tagged(norm.id, kind)
    if (known := asked.knows(tag)) is not None:
        return known
    headers = {"ETag": tag, "Vary": "Accept"}
    if kind == HDF5:
        headers |= attachment(f"{name}.h5")
        path = asked.store.norm_path(name)
        return Response(await asyncio.to_thread(path.read_bytes), 200, headers, HDF5)
    return Response(results.NormAnswer.of(norm).model_dump_json(), 200, headers, JSON)


@of_norms.delete("/{name}", status_code=204)
async def delete_norm(name: ModelName, asked: AskedNow) -> None:
    """Delete a norm; its name is free again."""
    await asyncio.to_thread(asked.store.delete_norm, name)


@of_norms.post("/{name}/deviations", **answers(of=results.CohortDeviationAnswer))
async def compare_with_norm(
    name: ModelName,
    wanted: Annotated[queries.DeviationRequest, Depends(body_of(queries.DeviationRequest))],
    asked: AskedAny,
) -> Response:
    """Compare stored sequences with a norm, each, and from five on together.

    p-values are exact where the recordings come from where the controls come from; with too few
    controls for the level the answer is refused. Together they tell whether another machine,
    protocol or group of people stands behind them than behind the controls; then single p-values
    speak of that, and not of a person. No diagnosis. Missing signatures are stored on the way.
    """
    await asyncio.to_thread(asked.store.norm_path, name)
    request = await asked.about(wanted, queries.DeviationOptions, reference=name)
    return await asked.do(operations.deviations, request)
