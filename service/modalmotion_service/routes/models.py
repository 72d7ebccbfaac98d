"""Models: trained on labelled sequences, listed, described, deleted."""

from __future__ import annotations

import asyncio
from typing import Annotated, Final

from fastapi import Header, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from modalmotion.classification import ModelCard, TrainingOptions, available_models, card_markdown
from modalmotion.store import ModelRecord, model_to_hdf5, require_model_name
from modalmotion.store.index.cursor import from_cursor, to_cursor
from modalmotion_service.http.conditional import is_known, not_modified, tag_of
from modalmotion_service.http.json_bodies import JsonRoute
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import CSV, HDF5, JSON, MARKDOWN, PNG, best_type
from modalmotion_service.http.preferences import Preference
from modalmotion_service.routes.parts.deferral import accepted, reply_or_job
from modalmotion_service.routes.parts.dependencies import PreferenceDependency, StateDependency
from modalmotion_service.routes.parts.idempotency import IdempotencyKey, idempotent_answer
from modalmotion_service.routes.parts.openapi_parts import ACCEPTED, BINARY, PROBLEMS, TEXT
from modalmotion_service.schemas import (
    ModelAnswer,
    ModelName,
    ModelPageAnswer,
    ModelSummary,
    ModelVersion,
    TrainingRequest,
)
from modalmotion_service.workspace.model_versions import ChosenModel, shipped_name
from modalmotion_service.workspace.spool import SpoolFile
from modalmotion_service.workspace.state import State
from modalmotion_service.workspace.training_set import look_up, write_cases

router = JudgedRouter(
    prefix="/v1/models", tags=["models"], responses=PROBLEMS, route_class=JsonRoute
)

_DESCRIPTION: Final[dict[int | str, dict[str, object]]] = {
    200: {"content": {PNG: BINARY, HDF5: BINARY, CSV: BINARY, MARKDOWN: TEXT}},
    **ACCEPTED,
}

AcceptHeader = Annotated[
    str,
    Header(
        description=f"{JSON}, {PNG} for a picture of the card, {MARKDOWN} for it as a page, "
        f"{CSV} for the held-out answers by case, or {HDF5} for the model."
    ),
]


@router.post("", status_code=202, response_class=Response, responses=ACCEPTED)
async def train(
    request: TrainingRequest, state: StateDependency, idempotency_key: IdempotencyKey = None
) -> Response:
    """Train a model on stored, labelled sequences, as the next version of its name.

    Always a job, whose result links to the new version. Missing signatures are fitted on the way.
    Labels and subjects are those at the time of the request.
    """

    async def make() -> Response:
        name = require_model_name(request.name)
        if name in available_models():
            raise shipped_name(name, "takes no further versions", "Choose another name.")
        options = TrainingOptions.from_json(request.options)
        most = state.settings.max_training_sequences
        # Up to a hundred thousand sequences: others are answered meanwhile.
        cases = await asyncio.to_thread(lambda: look_up(state.store, request.cases, most))
        file = SpoolFile(state.spool.new_path())
        try:
            await asyncio.to_thread(write_cases, file, cases)
            job = await state.runner.start(
                "training",
                {"file": file.path.name, "name": name, "options": options.as_json()},
            )
        except BaseException:
            file.remove()
            raise
        return accepted(job)

    fingerprint = ("POST models", await asyncio.to_thread(request.model_dump_json))
    return await idempotent_answer(state.idempotency, idempotency_key, fingerprint, make)


class ListQuery(BaseModel):
    """Which models to list."""

    model_config = ConfigDict(extra="forbid")

    limit: int = Field(100, ge=1, le=1000, description="Of one page.")
    cursor: str | None = Field(None, max_length=200, description="Of the page before.")


@router.get("")
def list_models(query: Annotated[ListQuery, Query()], state: StateDependency) -> ModelPageAnswer:
    """List models by name, including shipped ones, each with its newest version."""
    records = state.models.records()
    after = "" if query.cursor is None else from_cursor(query.cursor)[1]
    names = sorted(name for name in records if name > after)
    page = names[: query.limit]
    return ModelPageAnswer(
        models=[_summary(records[name]) for name in page],
        cursor=to_cursor("model", page[-1]) if len(names) > len(page) else None,
    )


@router.get("/{name}", response_model=ModelAnswer, responses=_DESCRIPTION)
async def newest(
    name: ModelName,
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: AcceptHeader = JSON,
) -> Response:
    """Describe the newest version of a model: its card, as data or as a picture."""
    model = await asyncio.to_thread(state.models.choose, name)
    return await _described(model, state, preference, request, accept)


@router.get("/{name}/versions/{version}", response_model=ModelAnswer, responses=_DESCRIPTION)
async def version(
    name: ModelName,
    version: ModelVersion,
    state: StateDependency,
    preference: PreferenceDependency,
    request: Request,
    accept: AcceptHeader = JSON,
) -> Response:
    """Describe a version of a model: its card, as data or as a picture; or give its file."""
    model = await asyncio.to_thread(state.models.choose, f"{name}@{version}")
    return await _described(model, state, preference, request, accept)


@router.delete("/{name}/versions/{version}", status_code=204)
async def delete(name: ModelName, version: ModelVersion, state: StateDependency) -> None:
    """Delete a version. Its number is not used again, and its classifications stay."""
    await asyncio.to_thread(state.models.delete, name, int(version))


async def _described(
    model: ChosenModel, state: State, preference: Preference, request: Request, accept: str
) -> Response:
    media_type = best_type(accept, (JSON, PNG, HDF5, CSV, MARKDOWN))
    content = await asyncio.to_thread(state.models.describe, model)
    versions = await asyncio.to_thread(state.models.versions, model.name)
    tag = tag_of(model.id, str(model.version), repr(versions), media_type)
    if media_type != CSV and is_known(request, tag):
        return not_modified(tag)
    headers = {"ETag": tag, "Vary": "Accept"}
    if media_type == PNG:
        body = {"model": f"{model.name}@{model.version}"}
        return await reply_or_job(state, preference, "model-view", body, headers=headers)
    if media_type == CSV:
        # Subjects may change.
        body = {"model": f"{model.name}@{model.version}"}
        return await reply_or_job(state, preference, "held-out", body, headers={"Vary": "Accept"})
    if media_type == HDF5:
        headers["Content-Disposition"] = f'attachment; filename="{model.name}-{model.version}.h5"'
        return Response(await asyncio.to_thread(model_to_hdf5, content), 200, headers, HDF5)
    if media_type == MARKDOWN:
        card = ModelCard.from_json(content.card)
        page = card_markdown(model.name, model.id, card, version=model.version)
        return Response(page, 200, headers, f"{MARKDOWN}; charset=utf-8")
    source = model.source
    file = None if isinstance(source, str) else state.analysis.within_store(source)
    answer = ModelAnswer.with_card(content, versions, file)
    return Response(answer.model_dump_json(), 200, headers, JSON)


def _summary(records: list[ModelRecord]) -> ModelSummary:
    return ModelSummary.of(records[-1], [record.version for record in records])
