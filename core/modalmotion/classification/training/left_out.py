"""Cases that a training goes on without."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from modalmotion.errors import (
    CorruptFileError,
    InputError,
    ModalMotionError,
    NotFoundError,
    OlderFileError,
)
from modalmotion.numerals import counted

UNUSABLE: Final = (InputError, NotFoundError, CorruptFileError, OlderFileError)
"""Errors of one case. Others, such as a full disk, are of all cases and end a training."""

# Cases that a card names; a longer list is a matter for the sender's own tables.
_MOST_NAMED: Final = 20


class LeftOut(NamedTuple):
    """A case that was left out, and why.

    Parameters
    ----------
    name : str
        What errors call the case, such as the path of its file.
    reason : str
    """

    name: str
    reason: str

    @staticmethod
    def of(error: ModalMotionError, name: str) -> LeftOut:
        """Leave a case out for an error, which may name it already."""
        return LeftOut(name, error.message.removeprefix(f"{name}: "))

    def __str__(self) -> str:
        return f"{self.name}: {self.reason}"


def left_out_notes(cases: Sequence[LeftOut]) -> tuple[str, ...]:
    """Name the cases that were left out, for a card or a summary."""
    if not cases:
        return ()
    more = len(cases) - _MOST_NAMED
    return (
        f"Cases left out: {len(cases)}.",
        *(f"Left out: {case}" for case in cases[:_MOST_NAMED]),
        *(
            (f"Left out besides: {counted(more, 'case')} that this list is too short for.",)
            if more > 0
            else ()
        ),
    )
