"""Labelled signatures that models are trained and tested on."""

from __future__ import annotations

from dataclasses import dataclass

from modalmotion.signature import ModalSignature


@dataclass(frozen=True, eq=False)
class TrainingCase:
    """One signature with its class.

    Parameters
    ----------
    signature : ModalSignature
    label : str
        Name of the class.
    subject : str or None
        Who was recorded: cases of one subject are never on both sides of a split. None for a
        subject of its own.
    """

    signature: ModalSignature
    label: str
    subject: str | None = None
