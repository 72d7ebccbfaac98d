"""Sequences: sent, listed, named, deleted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import Enum
from typing import Any

from modalmotion.client.answers import SequenceInfo, value_of
from modalmotion.client.bodies import Source, body_of, json_body
from modalmotion.client.calls import Calls, sequence_path
from modalmotion.client.connection import Answer, Call
from modalmotion.client.jobs import Job, awaited
from modalmotion.client.query import Option, stated_in
from modalmotion.facts import Facts
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.progress import Progress


class Unchanged(Enum):
    """Stands for a name that stays as it is."""

    UNCHANGED = "unchanged"


UNCHANGED = Unchanged.UNCHANGED


class SequenceCalls(Calls):
    """Sequences: sent, listed, named, deleted."""

    def upload(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> SequenceInfo:
        """Send a sequence, and wait until it is kept.

        What is known already is not kept twice: it has the same id.

        Parameters
        ----------
        source : path, bytes or MeshSequence
            A file of any format the service reads, by its path or as its bytes; or a sequence.
            Files and arrays are sent a piece at a time.
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.
        **options
            As the service names them: subject, label, topology, grid, unit, times, format, ...;
            and `facts`, or each by its name: tracking, period, ...

        Raises
        ------
        RemoteError
            If it cannot be used; names frame, vertex, limit and remedy.
        UnreachableError
            If no answer comes. Sent again it arrives once.
        """
        answer = self._connection.send(_upload(source, options), progress)
        return awaited(self._connection, answer, _info, "application/json")

    def upload_arrays(
        self,
        vertices: Any,
        faces: Any = None,
        *,
        grid: Any = None,
        topology: str | None = None,
        times: Any = None,
        unit: str | None = None,
        facts: Facts | None = None,
        subject: str | None = None,
        label: str | None = None,
        progress: Progress | None = None,
    ) -> SequenceInfo:
        """Send a sequence from arrays, which are checked before anything is sent.

        Parameters
        ----------
        vertices : (frames, vertices, 3) array_like, in `unit`
        faces : (faces, 3) array_like of int, optional
        grid, topology, times, unit, facts : optional
            As of `mesh_sequence`.
        subject, label : str, optional
        progress : callable, optional

        Raises
        ------
        InputError
            As `mesh_sequence` does.
        """
        sequence = mesh_sequence(
            vertices, faces, grid=grid, topology=topology, times=times, unit=unit, facts=facts
        )
        return self.upload(sequence, progress=progress, subject=subject, label=label)

    def start_upload(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> Job[SequenceInfo]:
        """Send a sequence, and leave reading it to a job of the service."""
        return self._started(_upload(source, options), _info, progress)

    def sequences(
        self, *, subject: str | None = None, label: str | None = None, page: int = 100
    ) -> Iterator[SequenceInfo]:
        """List sequences from the newest to the oldest, fetched a page at a time.

        Parameters
        ----------
        subject, label : str, optional
            Only those of that subject, with that label.
        page : int
            How many are fetched at once.
        """
        members = self._pages(
            "/v1/sequences", "sequences", subject=subject, label=label, limit=page
        )
        return (value_of(SequenceInfo, member) for member in members)

    def sequence(self, sequence_id: str) -> SequenceInfo:
        """Give what is known of a sequence.

        Raises
        ------
        NotFoundError
            If there is none of that id.
        """
        return _info(self._get(sequence_path(sequence_id)))

    def update(
        self,
        sequence_id: str,
        *,
        subject: str | Unchanged | None = UNCHANGED,
        label: str | Unchanged | None = UNCHANGED,
        facts: Facts | Mapping[str, Any] | Unchanged | None = UNCHANGED,
    ) -> SequenceInfo:
        """Change the subject, the label or facts; None takes one away.

        Parameters
        ----------
        sequence_id : str
        subject, label : str or None, optional
        facts : Facts, mapping or None, optional
            What is stated goes over what is kept. In a mapping None makes a fact unknown, and
            takes away one covariate: ``{"period": None, "covariates": {"age": None}}``.
        """
        if isinstance(facts, Facts):
            facts = stated_in(facts)
        names = {"subject": subject, "label": label, "facts": facts}
        changes = {name: value for name, value in names.items() if value is not UNCHANGED}
        return _info(
            self._connection.send(
                Call("PATCH", sequence_path(sequence_id), body=json_body(changes))
            )
        )

    def delete(self, sequence_id: str) -> None:
        """Delete a sequence with everything that derives from it."""
        self._connection.send(Call("DELETE", sequence_path(sequence_id)))


def _upload(source: Source, options: dict[str, Option]) -> Call:
    return Call("POST", "/v1/sequences", options, body=body_of(source), is_keyed=True)


def _info(answer: Answer) -> SequenceInfo:
    return value_of(SequenceInfo, answer.json)
