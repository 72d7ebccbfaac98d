"""Answers that every part of the service gives."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class Health(BaseModel):
    """State of the service."""

    status: Literal["ok"] = "ok"
    version: str


class Readiness(Health):
    """State of the service and of its workers."""

    stateless: bool = Field(
        description="Whether nothing is kept here; rates are then counted by each such service "
        "for itself."
    )
    parsers_confined: bool | None = Field(
        description="Whether what parses HDF5 and VTK sees nothing but its file; null where only "
        "the workers of a scheduler know."
    )


class Problem(BaseModel):
    """An error, after RFC 9457."""

    model_config = ConfigDict(extra="allow")

    type: str
    title: str
    status: int
    code: str = Field(description="Stable name of the kind of problem.")
    detail: str
    frame: int | None = Field(None, description="Frame at fault, counted from 0.")
    vertex: int | None = Field(None, description="Vertex at fault, counted from 0.")
    limit: str | None = Field(None, description="Limit that was exceeded.")
    remedy: str | None = Field(None, description="What to do about it.")
