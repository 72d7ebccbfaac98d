"""What is read from a signature: volumes, the price of each choice, pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from modalmotion.client.answers import Readouts, readouts_of
from modalmotion.client.calls import JSON, PNG, Calls, save, sequence_path
from modalmotion.client.connection import Answer, Call
from modalmotion.client.query import Option


class ReadoutCalls(Calls):
    """What is read from a signature."""

    def readouts(self, sequence_id: str, **options: Option) -> Readouts:
        """Give the volume over time and the ejection fraction, each with its bound.

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
        """Say what each choice of modes costs and loses, as the service gives it.

        Parameters
        ----------
        sequence_id : str
        **options
            Of the signature that is marked; and front_modes, components.
        """
        call = Call("GET", sequence_path(sequence_id, "tradeoff"), options, JSON)
        found: dict[str, Any] = self._awaited(call, lambda answer: answer.json)
        return found

    def save_signature_picture(self, sequence_id: str, path: str | Path, **options: Option) -> None:
        """Write a picture of a signature beside the surfaces, as PNG."""
        self._save_picture(sequence_path(sequence_id, "signature"), path, options)

    def save_readouts_picture(self, sequence_id: str, path: str | Path, **options: Option) -> None:
        """Write a picture of the volume over time, as PNG."""
        self._save_picture(sequence_path(sequence_id, "readouts"), path, options)

    def save_tradeoff_picture(self, sequence_id: str, path: str | Path, **options: Option) -> None:
        """Write a picture of what each choice of modes costs and loses, as PNG."""
        self._save_picture(sequence_path(sequence_id, "tradeoff"), path, options)

    def _save_picture(self, path: str, target: str | Path, options: dict[str, Option]) -> None:
        content = self._awaited(Call("GET", path, options, PNG), _content)
        save(content, Path(target))


def _content(answer: Answer) -> bytes:
    return answer.content
