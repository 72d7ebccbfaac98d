"""The cases of a cohort that a training goes on with."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import islice
from operator import attrgetter
from typing import Any

from modalmotion.classification.options import TrainingOptions
from modalmotion.classification.training.case_reading import (
    ReadCase,
    basis_of,
    read_cases,
    require_alike,
)
from modalmotion.classification.training.cases import AnyCase
from modalmotion.classification.training.left_out import LeftOut
from modalmotion.signature.making import ModalSignature, SignatureParameters


@dataclass(frozen=True, eq=False)
class KeptCases:
    """Cases that were read, and those that were left out.

    Parameters
    ----------
    cases : tuple of ReadCase
    numbers : tuple of int
        Of each, as it was given.
    left_out : tuple of LeftOut
    """

    cases: tuple[ReadCase, ...]
    numbers: tuple[int, ...]
    left_out: tuple[LeftOut, ...]

    def commonest(self, quality: Callable[[ReadCase], Any], why: str) -> KeptCases:
        """Keep the cases that share the commonest value of a quality; leave the others out."""
        values = [quality(case) for case in self.cases]
        (most, _), *others = Counter(values).most_common() or [(None, 0)]
        if not others:
            return self
        kept = [k for k, value in enumerate(values) if value == most]
        odd = [
            LeftOut(case.name or f"case {number}", why)
            for case, number, value in zip(self.cases, self.numbers, values, strict=True)
            if value != most
        ]
        return KeptCases(
            tuple(self.cases[k] for k in kept),
            tuple(self.numbers[k] for k in kept),
            (*self.left_out, *odd),
        )

    def of_one_surface(self) -> KeptCases:
        """Keep the cases of the commonest topology."""
        return self.commonest(attrgetter("surface"), "It has another topology than most.")

    def example(
        self, cases: Iterable[AnyCase], options: TrainingOptions, parameters: SignatureParameters
    ) -> ModalSignature | None:
        """Give the signature of the first one, read again unless it was the first of all.

        Parameters
        ----------
        cases : iterable of TrainingCase or CaseSource
            All of them, as they were given.
        options : TrainingOptions
        parameters : SignatureParameters
            Of the signatures of sequences.
        """
        if not self.cases or self.cases[0].signature is not None:
            return self.cases[0].signature if self.cases else None
        again = islice(iter(cases), self.numbers[0], self.numbers[0] + 1)
        first = next(iter(read_cases(again, options, parameters)))
        return None if isinstance(first, LeftOut) else first.signature


def keep_cases(
    cases: Iterable[AnyCase],
    options: TrainingOptions,
    parameters: SignatureParameters,
    progress: Callable[[int], None] | None,
    *,
    drops_unlike: bool,
) -> KeptCases:
    """Read cases whose modes compare.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseSource
    options : TrainingOptions
    parameters : SignatureParameters
        Of the signatures of sequences.
    progress : callable or None
        Called with the number of cases that have been read.
    drops_unlike : bool
        Whether cases that do not compare with most are left out.

    Raises
    ------
    UnlikeCasesError
        If they do not compare, and none is left out.
    ParameterError, ModalMotionError
        As `read_cases` says.
    """
    kept: list[ReadCase] = []
    numbers: list[int] = []
    left_out: list[LeftOut] = []
    for number, case in enumerate(read_cases(cases, options, parameters)):
        if isinstance(case, LeftOut):
            left_out.append(case)
        else:
            if kept and not drops_unlike:
                require_alike(case, kept[0], number)
            kept.append(case if not kept else replace(case, signature=None))
            numbers.append(number)
        if progress is not None:
            progress(number + 1)
    result = KeptCases(tuple(kept), tuple(numbers), tuple(left_out))
    return result.commonest(basis_of, "Its modes do not compare with those of most.")
