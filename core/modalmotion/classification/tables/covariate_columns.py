"""Covariates as columns of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError

# A covariate of more words is a name or a remark.
MOST_WORDS: Final = 20

ALL: Final = "all"
"""In place of names: every covariate that some case has."""


@dataclass(frozen=True)
class CovariateColumn:
    """A number, or whether a covariate is one word.

    Parameters
    ----------
    covariate : str
    word : str or None
    """

    covariate: str
    word: str | None = None

    @property
    def name(self) -> str:
        """Such as "covariate age", "covariate sex=f"."""
        return f"covariate {self.covariate}" + ("" if self.word is None else f"={self.word}")

    def of(self, case: Mapping[str, float | str]) -> float:
        """Value of a case; NaN where the covariate is unknown, or is a word and no number."""
        value = case.get(self.covariate)
        if value is None:
            return float("nan")
        if self.word is not None:
            return float(str(value) == self.word)
        return float("nan") if isinstance(value, str) else float(value)


def covariate_columns(
    cases: Sequence[Mapping[str, float | str]], wanted: str | Sequence[str] | None
) -> tuple[CovariateColumn, ...]:
    """Choose the columns of covariates.

    Parameters
    ----------
    cases : sequence of mapping
        Covariates of each case.
    wanted : None, "all" or sequence of str
        Their names. "all" leaves out covariates of more than `MOST_WORDS` words.

    Raises
    ------
    ParameterError
        If no case has one of them.
    """
    known: dict[str, list[float | str]] = {}
    for case in cases:
        for name, value in case.items():
            known.setdefault(name, []).append(value)
    if wanted is None:
        return ()
    names = sorted(known) if wanted == ALL else [wanted] if isinstance(wanted, str) else wanted
    unknown = [str(name) for name in names if name not in known]
    if unknown:
        raise ParameterError(
            f"No case has the covariate {unknown[0][:80]!r}.",
            remedy=f"Use {ALL!r}, or some of: {', '.join(sorted(known)) or 'there is none'}.",
            details={"covariates": sorted(known)},
        )
    columns: list[CovariateColumn] = []
    for name in names:
        words = sorted({str(value) for value in known[name]})
        if not any(isinstance(value, str) for value in known[name]):
            columns.append(CovariateColumn(name))
        elif wanted != ALL or len(words) <= MOST_WORDS:
            columns += [CovariateColumn(name, word) for word in words]
    return tuple(columns)


def covariate_values(
    cases: Sequence[Mapping[str, float | str]], columns: Sequence[CovariateColumn]
) -> NDArray[np.float64]:
    """Values of the columns, (cases, columns) float64; NaN where unknown."""
    values = [[column.of(case) for column in columns] for case in cases]
    return np.array(values, dtype=np.float64).reshape(len(cases), len(columns))
