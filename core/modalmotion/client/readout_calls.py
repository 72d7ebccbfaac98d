"""Readouts of a signature: volumes, the price of each choice, pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from modalmotion.client.calls import JSON, PNG, Calls, require_place, save, sequence_path
from modalmotion.client.connection import Answer, Call
from modalmotion.client.query import Option
from modalmotion.client.readouts import Readouts, readouts_of


class ReadoutCalls(Calls):
    """Readouts of a signature."""

    def readouts(self, sequence_id: str, **options: Option) -> Readouts:
        """Return the volume over time and the ejection fraction, each with its bound.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the signature: modes, template, ...

        Raises
        ------
        RemoteError
            If the surface encloses nothing.
        """
        return readouts_of(self._get(sequence_path(sequence_id, "readouts"), options).json)

    def tradeoff(self, sequence_id: str, **options: Option) -> dict[str, Any]:
        """Return the cost and the loss of each choice of modes, as the service's JSON.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the marked signature; and front_modes, components.
        """
        call = Call("GET", sequence_path(sequence_id, "tradeoff"), options, JSON)
        tradeoff: dict[str, Any] = self._awaited(call, lambda answer: answer.json)
        return tradeoff

    def save_signature_picture(self, sequence_id: str, path: str | Path, **options: Option) -> None:
        """Write a picture of a signature beside the surfaces, as PNG."""
        self._save_picture(sequence_path(sequence_id, "signature"), path, options)

    def save_readouts_picture(self, sequence_id: str, path: str | Path, **options: Option) -> None:
        """Write a picture of the volume over time, as PNG."""
        self._save_picture(sequence_path(sequence_id, "readouts"), path, options)

    def save_tradeoff_picture(self, sequence_id: str, path: str | Path, **options: Option) -> None:
        """Write a picture of the cost and the loss of each choice of modes, as PNG."""
        self._save_picture(sequence_path(sequence_id, "tradeoff"), path, options)

    def _save_picture(self, path: str, target: str | Path, options: dict[str, Option]) -> None:
        place = Path(target)
        require_place(place)
        save(self._awaited(Call("GET", path, options, PNG), _content), place)


def _content(answer: Answer) -> bytes:
    return answer.content
