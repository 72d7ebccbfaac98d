"""Stored sequences and templates: uploaded, listed, described, changed, deleted."""

import asyncio
from dataclasses import replace
from typing import Annotated

from fastapi import Depends, Query, Response

from modalmotion.mesh import NO_FACTS, Facts, facts_patched
from modalmotion.store import SequenceRecord
from modalmotion_service.http.gate import note_facts
from modalmotion_service.http.gated_router import GatedRouter, body_of
from modalmotion_service.http.negotiation import HDF5, JSON, NPZ, PNG, STREAM
from modalmotion_service.routes.asked import AskedAny, AskedNow, IdempotencyKey, answers, page_of
from modalmotion_service.routes.uploads import Sent, receiving
from modalmotion_service.schemas import requests, signatures
from modalmotion_service.schemas.from_core import Paging, SequenceId
from modalmotion_service.schemas.queries import ModesRequest, SequenceList
from modalmotion_service.schemas.sequences import SequencePageAnswer, SequenceSummary
from modalmotion_service.workspace import recording_operations as operations
from modalmotion_service.workspace.operation import Request
from modalmotion_service.workspace.recording_operations import erase, restate

router = GatedRouter(prefix="/v1/sequences", tags=["sequences"])


@router.post("", **answers(of=SequenceSummary, is_new=True))
async def upload_sequence(
    asked: AskedAny,
    sent: Annotated[Sent, Depends(receiving(requests.SEQUENCE))],
    idempotency_key: IdempotencyKey = None,
) -> Response:
    """Upload a sequence.

    A file (npz, VTKHDF, a zip of frames, GLB, raw numbers) as the body, or as the part `file` of a
    form; what is stated beside it overrides the file. The same content has the same id: 201 where
    it is new, 200 where it was known. Subject, label and facts that are stated with a known one are
    filled in where they are unknown; where they differ from what is known, the answer is 409, and
    PATCH changes them.
    """
    with sent.file as file:
        request = Request(query=sent.query)
        return await asked.do(operations.upload, request, file=file, key=idempotency_key)


@router.get("")
def list_sequences(query: Annotated[SequenceList, Query()], asked: AskedNow) -> SequencePageAnswer:
    """List sequences from the newest to the oldest, a page at a time."""
    page = asked.store.list_sequences(**query.model_dump())
    return SequencePageAnswer(
        sequences=[SequenceSummary.of(record) for record in page.records], cursor=page.cursor
    )


@router.post("/sample", response_model=SequenceSummary, include_in_schema=False)
async def sample(asked: AskedNow) -> Response:
    """Simulate a heart and keep it, for the first page."""
    return _summary(asked, await operations.sample(asked.state))


@router.get("/{sequence_id}", response_model=SequenceSummary)
def describe_sequence(sequence_id: SequenceId, asked: AskedNow) -> Response:
    """Describe a sequence."""
    return _summary(asked, SequenceSummary.of(asked.store.sequence_record(sequence_id)))


@router.patch("/{sequence_id}", response_model=SequenceSummary)
async def change_sequence(
    sequence_id: SequenceId,
    change: Annotated[requests.SequenceChange, Depends(body_of(requests.SequenceChange))],
    asked: AskedNow,
) -> Response:
    """Change name, subject, label, facts, unit and times of a sequence.

    What is left out stays, null removes it; facts are changed as by a JSON merge patch (RFC 7396).
    Results that depend on a changed fact are computed again on request; the others stay. Unit and
    times are part of the id: another sequence takes the place of this one, which is deleted with
    its results, and the answer and Content-Location name the new one. Positions stay as they are.
    """
    stated = change.model_fields_set
    changed: list[str] = []

    def changed_facts(known: Facts) -> Facts:
        if "facts" not in stated:
            return known
        facts = NO_FACTS if change.facts is None else facts_patched(known, change.facts.changes)
        changed.extend(facts.changed(known))
        return facts

    names = {name: getattr(change, name) for name in ("name", "subject", "label") if name in stated}

    def changed_record(known: SequenceRecord) -> SequenceRecord:
        return replace(known, **names, facts=changed_facts(known.facts))

    current = sequence_id
    # Unit and times are part of the id.
    if stated & {"unit", "times"}:
        record = await restate(asked.state, sequence_id, change, changed_record)
        current = record.id
        asked.note(current)
    if current == sequence_id:
        record = await asyncio.to_thread(
            asked.store.update_sequence, sequence_id, change=changed_facts, **names
        )
    places = (f"/v1/{kind}/{current}" for kind in ("sequences", "tracks"))
    summary = SequenceSummary.of(record)
    known = summary.model_dump(mode="json", include={"name", "subject", "label", "facts"})
    await asyncio.to_thread(asked.state.idempotency.restate, known, *places)
    note_facts(asked.http, changed)
    answer = _summary(asked, summary)
    answer.headers["Content-Location"] = answer.headers["location"]
    return answer


@router.delete("/{sequence_id}", status_code=204)
async def delete_sequence(sequence_id: SequenceId, asked: AskedNow) -> None:
    """Delete a sequence with everything that derives from it, its track too."""
    await erase(asked.state, sequence_id)


@router.post("/{sequence_id}/tradeoff", **answers(JSON, PNG, of=signatures.TradeoffAnswer))
async def trade_sequence(
    sequence_id: SequenceId,
    trade: Annotated[requests.TradeRequest, Depends(body_of(requests.TRADE))],
    asked: AskedAny,
) -> Response:
    """Measure cost and error of each choice of modes on a sequence.

    Modes, harmonics, components and topologies at once, and the requested point among them; nothing
    is stored.
    """
    trade.parameters()
    asked.store.sequence_record(sequence_id)
    return await asked.do(operations.tradeoff, Request(query=trade, sequence_id=sequence_id))


@router.get("/{sequence_id}/encoded", **answers(STREAM))
async def encode_sequence(
    sequence_id: SequenceId, query: Annotated[requests.EncodingTarget, Query()], asked: AskedAny
) -> Response:
    """Give a sequence as a compressed stream; its size and errors are in the headers Encoded-..."""
    asked.store.sequence_path(sequence_id)
    return await asked.do(operations.encoding, Request(query=query, sequence_id=sequence_id))


def _summary(asked: AskedNow, summary: SequenceSummary) -> Response:
    return asked.json(summary, headers={"Location": summary.links["self"]})


of_templates = GatedRouter(prefix="/v1/templates", tags=["templates"])


@of_templates.post("", **answers(of=signatures.TemplateAnswer, is_new=True))
async def make_template(
    sent: Annotated[Sent, Depends(receiving(requests.SIGNATURE_OF_FILE))], asked: AskedAny
) -> Response:
    """Make the template of a sequence's reference frame, and store it.

    A cohort whose vertices correspond names it (`template`) and pays for it once.
    """
    with sent.file as file:
        sent.query.parameters()
        return await asked.do(operations.template, Request(query=sent.query), file=file)


@of_templates.get("")
async def list_templates(
    query: Annotated[Paging, Query()], asked: AskedNow
) -> signatures.TemplatePageAnswer:
    """List the ids of templates, sorted, a page at a time."""
    ids = await asyncio.to_thread(asked.store.templates)
    page, cursor = page_of(list(ids), query.limit, query.cursor)
    return signatures.TemplatePageAnswer(templates=page, cursor=cursor)


@of_templates.get("/{template_id}", **answers(JSON, PNG, of=signatures.TemplateAnswer))
async def describe_template(template_id: SequenceId, asked: AskedAny) -> Response:
    """Describe a template, or draw s and theta on its surface."""
    asked.store.template_path(template_id)
    request = Request(reference=template_id)
    return await asked.do(operations.template_view, request, tag=(template_id,))


@of_templates.get(
    "/{template_id}/modes", **answers(JSON, NPZ, HDF5, PNG, of=signatures.ModesAnswer)
)
async def modes_of_template(
    template_id: SequenceId, query: Annotated[ModesRequest, Query()], asked: AskedAny
) -> Response:
    """Give the vibration modes of a template: labels, angular frequencies and shapes.

    Shapes come as npz or HDF5, or in JSON with `shapes=true`; a picture shows them in colour.
    """
    asked.store.template_path(template_id)
    request = Request(query=query, reference=template_id)
    return await asked.do(operations.template_modes, request, tag=(template_id,))


@of_templates.delete("/{template_id}", status_code=204)
async def delete_template(template_id: SequenceId, asked: AskedNow) -> None:
    """Delete a template, and with it the reference vertices that it holds.

    Signatures that were fitted on it stay; they can no longer be reconstructed.
    """
    await asyncio.to_thread(asked.store.delete_template, template_id)
