"""The modes that moved a prediction: by how much, and in millimetres."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.motion import Column, Motion
from modalmotion.classification.motion_features import waves_of
from modalmotion.errors import ParameterError
from modalmotion.modes import Modes
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature

if TYPE_CHECKING:
    from modalmotion.classification.model import Model

Array = NDArray[np.float64]


@shown()
@dataclass(frozen=True)
class ModeContribution:
    """Effect of one mode, or of a cosine-sine pair, on a prediction.

    Parameters
    ----------
    modes : tuple of str
        Labels of the modes.
    score : float
        Contribution of their amplitudes to the log of (probability of the most probable class over
        that of the next), beyond those of an average training case.
    amplitude : float, `unit`
        RMS over time of their deviation from the temporal mean.
    unit : str or None
    """

    modes: tuple[str, ...]
    score: float
    amplitude: float
    unit: str | None


def explain(
    features: Array, model: Model, motion: Motion, probabilities: Array
) -> tuple[ModeContribution, ...]:
    """Contributions of the modes to a prediction, the strongest first.

    Scores are linear in the features, so contributions beyond an average case add up to the whole;
    features of several modes belong to none of them.
    """
    first, second = np.argsort(-probabilities, kind="stable")[:2]
    lead = (features - model.centre) * (model.weights[:, first] - model.weights[:, second])
    signature = motion.signature
    moving = signature.amplitudes - signature.amplitudes.mean(axis=0)
    squares = np.einsum("fmi,fmi->m", moving, moving) / signature.n_frames
    parts = [
        ModeContribution(
            modes=tuple(str(motion.modes.labels[k]) for k in group),
            score=float(lead[list(places)].sum()),
            amplitude=math.sqrt(sum(squares[k] for k in group)),
            unit=signature.unit,
        )
        for group, places in _groups(model.columns, motion.modes)
    ]
    return tuple(sorted(parts, key=lambda part: -abs(part.score)))


@lru_cache(maxsize=32)
def _groups(
    columns: tuple[Column, ...], modes: Modes
) -> tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]:
    """Modes, cosine and sine of one wave together, and the features that are read from them."""
    read = [
        (group, tuple(k for k, column in enumerate(columns) if _is_of(column, group)))
        for group in waves_of(modes, walls=False).modes
    ]
    return tuple((group, places) for group, places in read if places)


def _is_of(column: Column, group: tuple[int, ...]) -> bool:
    return bool(column.modes) and set(column.modes) <= set(group)


def only_modes(signature: ModalSignature, modes: Iterable[str]) -> ModalSignature:
    """Signature in which only some modes move: the moving mesh that an explanation represents.

    Parameters
    ----------
    signature : ModalSignature
    modes : iterable of str
        Labels, as in `ModeContribution.modes`.

    Returns
    -------
    ModalSignature
        For `reconstruct` or `write_superposed` together with the sequence. The other modes
        keep their temporal mean; rotation and drift stay.

    Raises
    ------
    ParameterError
        If the signature has no such mode.
    """
    place = {str(label): k for k, label in enumerate(signature.modes.labels)}
    moves = np.zeros(len(place), dtype=np.bool_)
    for label in modes:
        if label not in place:
            raise ParameterError(
                f"The signature has no mode {str(label)[:40]!r}.",
                remedy=f"Use some of: {', '.join(list(place)[:20])}.",
            )
        moves[place[label]] = True
    still = np.broadcast_to(signature.amplitudes.mean(axis=0), signature.amplitudes.shape)
    amplitudes = np.where(moves[None, :, None], signature.amplitudes, still)
    return replace(signature, amplitudes=amplitudes)
