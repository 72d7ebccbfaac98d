"""The modes that moved a prediction: by how much, and in millimetres."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import Columns
from modalmotion.errors import ParameterError
from modalmotion.modes import Modes
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature

if TYPE_CHECKING:
    from modalmotion.classification.answer.hands import Reading
    from modalmotion.classification.model.model import Model


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
    reading: Reading, model: Model, probabilities: NDArray[np.float64]
) -> tuple[ModeContribution, ...]:
    """Contributions of the modes to a prediction, the strongest first.

    Parameters
    ----------
    reading : Reading
    model : Model
    probabilities : (classes,) float64

    Returns
    -------
    tuple of ModeContribution

    Notes
    -----
    The score of a group of features is the mean of what it adds to an average case and of what
    it takes from this one: the Shapley value of two players, the group and all others (Shapley,
    A value for n-person games, 1953). For a linear score these add up to the whole.
    """
    signature, values = reading.signature, reading.values
    players = _players(reading.columns, signature.modes)
    if not players.modes:
        return ()
    member = players.member
    average = model.centre
    added = np.where(member, values, average)
    taken = np.where(member, average, values)
    logs = model.log_shares(np.concatenate([added, taken, values[None], average[None]]))
    first, second = np.argsort(-probabilities, kind="stable")[:2]
    lead = logs[:, first] - logs[:, second]
    n = len(member)
    scores = 0.5 * ((lead[:n] - lead[-1]) + (lead[-2] - lead[n : 2 * n]))
    moving = signature.amplitudes - np.add.reduce(signature.amplitudes) / signature.n_frames
    # Mean squares over time of each mode.
    squares = np.einsum("fmi,fmi->m", moving, moving) / signature.n_frames
    contributions = [
        ModeContribution(
            modes=labels,
            score=score,
            amplitude=math.sqrt(sum(squares[k] for k in group)),
            unit=signature.unit,
        )
        for group, labels, score in zip(players.modes, players.labels, scores.tolist(), strict=True)
    ]
    return tuple(sorted(contributions, key=lambda part: -abs(part.score)))


def only_modes(signature: ModalSignature, modes: Iterable[str]) -> ModalSignature:
    """Signature in which only some modes move: the moving mesh that an explanation stands for.

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


class _Players(NamedTuple):
    """Groups of modes that share a prediction among them.

    Parameters
    ----------
    modes : tuple of tuple of int
    labels : tuple of tuple of str
    member : (groups, features) bool
        Features that are read from the modes of a group alone.
    """

    modes: tuple[tuple[int, ...], ...]
    labels: tuple[tuple[str, ...], ...]
    member: NDArray[np.bool_]


@lru_cache(maxsize=32)
def _players(columns: Columns, modes: Modes) -> _Players:
    # Features of many modes belong to none of them.
    groups = [g for g in dict.fromkeys(column.modes for column in columns) if len(g) <= 2]
    # Cosine and sine of one wave vector.
    pairs = [g for g in groups if len(g) == 2 and len({modes.labels[k][0] for k in g}) == 1]
    paired = {k for g in pairs for k in g}
    singles = [(k,) for k in range(len(modes)) if k not in paired] if groups else []
    players = []
    for group in (*pairs, *singles):
        member = [len(column.modes) > 0 and set(column.modes) <= set(group) for column in columns]
        if any(member):
            players.append((group, tuple(str(modes.labels[k]) for k in group), member))
    mode_groups, labels, members = zip(*players, strict=True) if players else ((), (), ())
    return _Players(mode_groups, labels, np.array(members, dtype=np.bool_))
