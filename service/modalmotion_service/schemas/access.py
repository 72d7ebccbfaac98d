"""The audit log over the wire."""

from __future__ import annotations

from pydantic import BaseModel, Field

from modalmotion_service.audit.entry import AuditEntry


class AuditEntryAnswer(BaseModel):
    """Who asked for what."""

    number: int = Field(description="Counted from 1, without gaps.")
    time: str = Field(description="ISO 8601 in UTC.")
    owner: str | None = Field(description="Null where nobody was recognised.")
    key_id: str | None = Field(description="Null for a request from this machine without a key.")
    client: str = Field(
        description="Address that the request came from, or the command line's user."
    )
    method: str = Field(description="COMMAND for one of the command line.")
    route: str = Field(description="By its template, or the command; empty where there is none.")
    ids: list[str] = Field(description="What it was about.")
    status: int = Field(
        description="Of the answer; 102 for the entry that is written before a change."
    )
    request_id: str
    sha256: str = Field(description="Of this entry and of the digest of the one before.")

    @staticmethod
    def of(entry: AuditEntry) -> AuditEntryAnswer:
        """Write an entry out."""
        values = {**vars(entry), **vars(entry.event), "ids": entry.event.ids.split()}
        return AuditEntryAnswer.model_validate(values)


class AuditPageAnswer(BaseModel):
    """A page of the audit log."""

    entries: list[AuditEntryAnswer]
    cursor: int | None = Field(description="For the next page; null on the last.")
