"""How far a recording is from controls, and how strange it is beside them: conformal p-values.

The recording in question is in one bag with the controls, and everything is computed from the
bag as if nobody knew which it is. Where it comes from where the controls come from, each of the
n + 1 places in the order of strangeness is then as likely as any other, so P(p <= a) is
floor(a (n + 1)) / (n + 1) whatever the distribution: no Gaussian is believed (Vovk, Gammerman,
Shafer, Algorithmic Learning in a Random World, 2005, full conformal prediction).
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import scipy

from modalmotion.notes import Note
from modalmotion.representation import Floats, numeral, shown

# First words of the columns about an axis.
_ABOUT_AXIS: Final = {
    "radial": "contraction",
    "turning": "twist",
    "axial": "shortening",
    "across": "bending",
    "tilt": "bending",
    "oval": "oval shape",
    "side": "one side against the other",
    "lobe": "lobes",
}
_TOGETHER: Final = "how the waves go together"


@shown("name", "p", "p_alone", "words")
@dataclass(frozen=True)
class GroupDeviation:
    """One group of features beside the controls'.

    Parameters
    ----------
    name : str
        Such as "contraction", "twist" or "wave (1, 1)".
    p : float
        Corrected: small p-values of any group are no more frequent than stated.
    p_alone : float
        Of this group, as if it were the only one.
    share_less : float
        Share of the controls with less of it.
    deviates : bool
        Whether the corrected p-value is at most the level.
    """

    name: str
    p: float
    p_alone: float
    share_less: float
    deviates: bool

    @property
    def words(self) -> str:
        """The group in a sentence."""
        if not self.deviates:
            return f"{self.name}: as in controls (p = {numeral(self.p)})"
        how = "of another kind than"
        if self.share_less >= 0.95:
            how = "more than"
        elif self.share_less <= 0.05:
            how = "less than"
        return f"{self.name}: {how} in controls (p = {numeral(self.p)}, corrected)"


@shown("name", "value", "unit", "p", "share_less")
@dataclass(frozen=True)
class QuantityDeviation:
    """A clinical quantity beside the controls'.

    Parameters
    ----------
    name : str
        "ejection_fraction", "volume_change", "end_diastolic_volume" or "end_systolic_volume".
    value : float
    unit : str
        "%" or "ml".
    p : float
        Two-sided, of this quantity alone.
    share_less : float
        Share of the controls with a smaller one.
    """

    name: str
    value: float
    unit: str
    p: float
    share_less: float

    @property
    def words(self) -> str:
        """The name in a sentence."""
        return self.name.replace("end_", "end-").replace("_", " ")


@shown("norm", "p", "deviates", "n_controls", "level", "sequence_id")
@dataclass(frozen=True, kw_only=True)
class Deviation:
    """A recording beside controls; every field is JSON-able.

    Parameters
    ----------
    norm, norm_id : str
    sequence_id : str
    n_controls : int
    level : float
        At which something is called a deviation.
    attainable : float
        Share of recordings like the controls for which the whole is called one; the same holds
        of the groups together.
    p : float
        Of the whole motion: share of the controls and itself that is at least as strange.
    deviates : bool
    groups : tuple of GroupDeviation
    quantities : tuple of QuantityDeviation
    covariates : tuple of str
        Those that are accounted for.
    warnings : tuple of str
        In what this recording was not made like the controls: then a p-value says that, too.
    notes : tuple of Note
    """

    norm: str
    norm_id: str
    sequence_id: str
    n_controls: int
    level: float
    attainable: float
    p: float
    deviates: bool
    groups: tuple[GroupDeviation, ...]
    quantities: tuple[QuantityDeviation, ...]
    covariates: tuple[str, ...]
    warnings: tuple[str, ...]
    notes: tuple[Note, ...]

    @property
    def lines(self) -> str:
        """The answer in words, line by line."""
        warnings = [f"warning: {words}" for words in self.warnings]
        return "\n".join([*self.findings, *warnings, *(f"note: {words}" for words in self.notes)])

    @property
    def findings(self) -> tuple[str, ...]:
        """What was found, as lines."""
        verdict = "deviates from" if self.deviates else "is within"
        covariates = ", ".join(self.covariates)
        share = f"{100 * self.attainable:.1f} % of recordings like the controls"
        return (
            f"{verdict} the {self.n_controls} controls of {self.norm}: p = {numeral(self.p)}",
            f"  {share} would be called a deviation (level {self.level:g})",
            *(f"  {group.words}" for group in self.groups),
            *(
                f"  {one.words}: p = {numeral(one.p)}, "
                f"{100 * one.share_less:.0f} % of the controls have a smaller one"
                for one in self.quantities
            ),
            *([f"  accounted for: {covariates}"] if covariates else []),
        )

    def as_json(self) -> dict[str, Any]:
        """Every field as JSON values, and each group in words."""
        groups = [{**asdict(group), "words": group.words} for group in self.groups]
        return {**asdict(self), "groups": groups}


@shown("norm", "p", "is_another", "n_recordings")
@dataclass(frozen=True, kw_only=True)
class CohortDeviation:
    """Recordings beside controls, each and together; every field is JSON-able.

    Parameters
    ----------
    norm, norm_id : str
    n_controls, n_recordings : int
    level : float
    p : float or None
        That exchanging controls and recordings sets them as far apart, by chance; None of fewer
        than five recordings.
    is_another : bool or None
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
    p: float | None
    is_another: bool | None
    warning: str | None
    deviations: tuple[Deviation, ...]

    def as_json(self) -> dict[str, Any]:
        """Every field as JSON values."""
        return {**asdict(self), "deviations": [one.as_json() for one in self.deviations]}


def group_of(column: str) -> str:
    """Give the group of a column, by its name.

    Modes as they are have a group for each wave over the surface; what relates several is one
    of its own.
    """
    first = column.split(" ", 1)[0]
    if first in _ABOUT_AXIS:
        return _ABOUT_AXIS[first]
    if column.startswith("size (") and column.count("(") == 1:
        return f"wave {column[column.index('(') : column.index(')') + 1]}"
    if column == "log motion":
        return "amount of motion"
    return _TOGETHER


def groups_of(columns: Sequence[str]) -> dict[str, list[int]]:
    """Give the indices of the columns of each group, in their order."""
    groups: dict[str, list[int]] = {}
    for k, column in enumerate(columns):
        groups.setdefault(group_of(column), []).append(k)
    return groups


# Spread of a column, over its size, that is rounding.
_ROUNDING: Final = 1e-12


LEVEL: Final = 0.05
"""Level at which something is called a deviation, unless one is stated."""


def fewest_controls(level: float) -> int:
    """Give the controls that a level needs: with fewer no p-value is as small.

    Parameters
    ----------
    level : float
        Between 0 and 1.
    """
    return math.ceil(1.0 / level - 1e-9) - 1


def attainable(level: float, n: int) -> float:
    """Share of false alarms among recordings like the n controls, at most the level."""
    return math.floor(level * (n + 1) + 1e-9) / (n + 1)


def as_strange(scores: Floats, own: float) -> float:
    """Share of a bag, (members,), that is at least as strange as its member of that score."""
    return float((scores >= own).mean())


def strangeness(table: Floats, groups: Sequence[list[int]]) -> Floats:
    """Strangeness of each member of a bag in each group of columns, over its mean in the bag.

    Parameters
    ----------
    table : (members, columns) float64
        Columns of a group are of one unit and are not scaled, so that those in which hardly
        anything moves count as little as they move.
    groups : sequence of list of int
        Columns of each.

    Returns
    -------
    (groups, members) float64
        The sum over the groups is that of the whole. The share of the bag whose greatest value in
        any group is at least that of the member in one is its corrected p-value: at most a share
        `attainable` of recordings like the controls has any that is at most the level (Westfall
        and Young, 1993, in one step).
    """
    squares = (table - table.mean(axis=0)) ** 2
    scores = np.array([squares[:, columns].sum(axis=1) for columns in groups])
    mean = scores.mean(axis=1, keepdims=True)
    return np.asarray(scores / np.where(mean > 0.0, mean, 1.0))


def standardised(table: Floats) -> Floats:
    """Columns about their mean over their deviation; those that do not vary are left out."""
    spread = table.std(axis=0)
    varies = spread > _ROUNDING * np.maximum(np.abs(table).max(axis=0), np.finfo(float).tiny)
    return np.asarray((table[:, varies] - table[:, varies].mean(axis=0)) / spread[varies])


def without_covariates(table: Floats, covariates: Floats) -> Floats:
    """Take out of each column what depends on covariates linearly, (members, columns).

    Parameters
    ----------
    table : (members, columns) float64
    covariates : (members, covariates) float64
    """
    if not covariates.shape[1]:
        return table
    span = scipy.linalg.orth(np.column_stack([np.ones(len(table)), standardised(covariates)]))
    # A member far out among the covariates bends the line towards itself: the others' scale.
    leverage = np.minimum((span**2).sum(axis=1), 0.99)
    return np.asarray((table - span @ (span.T @ table)) / np.sqrt(1.0 - leverage)[:, None])


def exchange_p(table: Floats, n: int, n_exchanges: int = 1999) -> float:
    """Share of exchanges that set the first n of a bag as far apart from the others.

    By the energy distance (Szekely and Rizzo, Testing for equal distributions in high dimension,
    InterStat, 2004).

    Parameters
    ----------
    table : (members, columns) float64
        Of one scale.
    n : int
    n_exchanges : int
    """
    apart = scipy.spatial.distance.cdist(table, table)
    first = np.tile(np.arange(len(table)) < n, (n_exchanges + 1, 1)).astype(np.float64)
    first[1:] = np.random.default_rng(0).permuted(first[1:], axis=1)
    weights = first / n - (1.0 - first) / (len(table) - n)
    # Twice the mean distance across less those within is the square form of the weights.
    energies = -((weights @ apart) * weights).sum(axis=1)
    return float((energies >= energies[0] * (1.0 - 1e-12)).mean())
