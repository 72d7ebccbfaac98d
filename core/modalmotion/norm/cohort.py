"""Whether a cohort comes from where the controls come from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features import like_most
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm.controls import Reading
from modalmotion.norm.deviation import Deviation
from modalmotion.norm.norm import LEVEL, Norm, require_level
from modalmotion.norm.ranks import standardised
from modalmotion.numerals import counted, numeral
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature

FEWEST_RECORDINGS: Final = 5

_N_EXCHANGES: Final = 1999
_SEED: Final = 0

# Conditions that are numbers: where they differ, another machine or protocol stands behind.
_CONDITIONS: Final = ("frames", "frame rate", "vertices")


@shown("norm", "p", "is_another", "n_recordings")
@dataclass(frozen=True, kw_only=True)
class CohortDeviation:
    """Recordings beside controls, each and together; every field is JSON-able.

    Parameters
    ----------
    norm, norm_id : str
    n_controls, n_recordings : int
    level : float
    p : float
        That exchanging controls and recordings sets them as far apart, by chance.
    is_another : bool
        Whether it is at most the level: then single p-values speak of the cohort, and not of
        the people in it.
    warning : str or None
        The same in words.
    deviations : tuple of Deviation
    """

    norm: str
    norm_id: str
    n_controls: int
    n_recordings: int
    level: float
    p: float
    is_another: bool
    warning: str | None
    deviations: tuple[Deviation, ...]

    def as_json(self) -> dict[str, Any]:
        """Every field as JSON values."""
        return {**asdict(self), "deviations": [one.as_json() for one in self.deviations]}


def cohort_deviation(
    norm: Norm,
    recordings: Iterable[MeshSequence | ModalSignature | Reading],
    *,
    level: float = LEVEL,
) -> CohortDeviation:
    """Compare several recordings with the controls, each and together.

    Together by the energy distance (Szekely and Rizzo, 2004) of features, volumes and conditions
    between recordings and controls, beside those of 1,999 exchanges of the two.

    Parameters
    ----------
    norm : Norm
    recordings : iterable of MeshSequence, ModalSignature or Reading
        At least five that are no controls.
    level : float
        Of each, and of the warning.

    Raises
    ------
    ParameterError
        If there are too few.
    ModalMotionError
        If one does not compare.
    """
    level = require_level(level)
    readings = [one if isinstance(one, Reading) else norm.read(one) for one in recordings]
    others = others_than(norm, readings)
    if len(others) < FEWEST_RECORDINGS:
        raise ParameterError(
            f"Without the controls {counted(len(others), 'recording')} came.",
            remedy=f"Give at least {FEWEST_RECORDINGS} to compare a cohort, or compare each alone.",
            details={"n": len(others), "needed": FEWEST_RECORDINGS},
        )
    deviations = tuple(norm.deviation(one, level=level) for one in readings)
    p = _exchange_p([*norm.controls, *others], norm.n_controls)
    is_another = p <= level
    warning = None
    if is_another:
        warning = (
            f"These {len(readings)} recordings as a whole are unlike the controls (p = "
            f"{numeral(p, 4)}): another machine, protocol or group of people. Their p-values say "
            "that, too."
        )
    return CohortDeviation(
        norm=norm.name,
        norm_id=norm.id,
        n_controls=norm.n_controls,
        n_recordings=len(readings),
        level=level,
        p=p,
        is_another=is_another,
        warning=warning,
        deviations=deviations,
    )


def others_than(norm: Norm, readings: Sequence[Reading]) -> list[Reading]:
    """Leave out readings of the controls themselves."""
    theirs = {one.sequence_id for one in norm.controls}
    return [one for one in readings if one.sequence_id not in theirs]


def _exchange_p(bag: list[Reading], n: int) -> float:
    """Share of exchanges that set the first n as far apart from the others."""
    features, _, _ = like_most([one.values for one in bag])
    beside = [standardised(features) / np.sqrt(max(1, features.shape[1]))]
    more = np.array([_numbers(one) for one in bag])
    beside.append(standardised(more[:, np.isfinite(more).all(axis=0)]) / 2.0)
    table = np.concatenate(beside, axis=1)
    squares = (table**2).sum(axis=1)
    apart = np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * table @ table.T, 0.0))
    rng = np.random.default_rng(_SEED)
    first = np.zeros((_N_EXCHANGES + 1, len(bag)))
    first[0, :n] = 1.0
    for row in first[1:]:
        row[rng.permutation(len(bag))[:n]] = 1.0
    energies = _energy(apart, first)
    return float((energies >= energies[0] * (1.0 - 1e-12)).mean())


def _numbers(one: Reading) -> list[float]:
    conditions = [one.conditions.get(name, np.nan) for name in _CONDITIONS]
    numbers = [c if isinstance(c, int | float) else np.nan for c in conditions]
    return [*map(float, numbers), *one.quantities.tolist()]


def _energy(apart: NDArray[np.float64], first: NDArray[np.float64]) -> NDArray[np.float64]:
    """Energy distance between the marked and the others, (exchanges,) float64."""
    second = 1.0 - first
    n, m = first[0].sum(), second[0].sum()
    from_first = first @ apart
    across = (from_first * second).sum(axis=1) / (n * m)
    within = (from_first * first).sum(axis=1) / n**2
    other = ((second @ apart) * second).sum(axis=1) / m**2
    energy: NDArray[np.float64] = 2.0 * across - within - other
    return energy
