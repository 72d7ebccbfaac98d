"""Mesh sequences: upload and summary."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel, ConfigDict, Field

from modalmotion.formats import read_npz
from modalmotion.topology import Topology
from modalmotion_service.dependencies import SettingsDependency, StoreDependency, Upload
from modalmotion_service.openapi_parts import PROBLEMS, UPLOAD_BODY
from modalmotion_service.schemas import SequenceId, SequenceSummary, parse_grid

router = APIRouter(prefix="/v1/sequences", tags=["sequences"], responses=PROBLEMS)


class UploadQuery(BaseModel):
    """What may be said of an upload beside the file, over what the file says."""

    model_config = ConfigDict(extra="forbid")

    topology: str | None = Field(None, max_length=80)
    grid: str | None = Field(
        None,
        pattern=r"^[1-9][0-9]{0,8}(,[1-9][0-9]{0,8}){0,2}$",
        description="Nodes along each axis of a lattice, such as 32,64.",
    )
    unit: str | None = Field(None, max_length=20, description="m, cm, mm, um or nm.")
    subject: str | None = Field(None, max_length=200, description="Whose surface it is.")
    label: str | None = Field(None, max_length=200, description="Known motion class.")


@router.post(
    "",
    status_code=201,
    openapi_extra=UPLOAD_BODY,
    responses={200: {"model": SequenceSummary, "description": "Known already."}},
)
def upload(
    body: Upload,
    query: Annotated[UploadQuery, Query()],
    settings: SettingsDependency,
    store: StoreDependency,
    response: Response,
) -> SequenceSummary:
    """Keep a mesh sequence, sent as .npz.

    The same content has the same id: 201 when it is new, 200 when it was known.
    """
    read = read_npz(body, settings.read_limits)
    sequence = read.sequence.with_topology(
        None if query.topology is None else Topology.parse(query.topology),
        parse_grid(query.grid),
    )
    if query.unit is not None:
        sequence = sequence.with_unit(query.unit)
    is_new = store.put_sequence(sequence, subject=query.subject, label=query.label)
    response.status_code = 201 if is_new else 200
    response.headers["Location"] = f"/v1/sequences/{sequence.id}"
    return SequenceSummary.of(store.sequence_record(sequence.id), read.ignored)


@router.get("/{sequence_id}")
def summary(sequence_id: SequenceId, store: StoreDependency) -> SequenceSummary:
    """Give what is known of a sequence."""
    return SequenceSummary.of(store.sequence_record(sequence_id))
