"""How far a recording lies from controls, and what is said of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from modalmotion.representation import numeral, shown

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
    notes : tuple of str
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
    notes: tuple[str, ...]

    @property
    def lines(self) -> str:
        """The answer in words, line by line."""
        return "\n".join([*self.findings, *self.remarks])

    @property
    def remarks(self) -> tuple[str, ...]:
        """Warnings and notes, as lines."""
        warnings = [f"warning: {words}" for words in self.warnings]
        return (*warnings, *(f"note: {words}" for words in self.notes))

    @property
    def findings(self) -> tuple[str, ...]:
        """What was found, as lines."""
        verdict = "deviates from" if self.deviates else "lies within"
        share = f"{100 * self.attainable:.1f} % of recordings like the controls"
        lines = [
            f"{verdict} the {self.n_controls} controls of {self.norm}: p = {numeral(self.p)}",
            f"  {share} would be called a deviation (level {self.level:g})",
            *(f"  {group.words}" for group in self.groups),
            *(
                f"  {one.words}: p = {numeral(one.p)}, "
                f"{100 * one.share_less:.0f} % of the controls have a smaller one"
                for one in self.quantities
            ),
        ]
        if self.covariates:
            lines.append(f"  accounted for: {', '.join(self.covariates)}")
        return tuple(lines)

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
