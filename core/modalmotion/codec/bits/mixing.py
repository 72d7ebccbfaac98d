"""Binary coder with context mixing.

Each context counts how often its question was answered yes and no. What they expect is added
up with weights in the logarithms of odds, and the weights learn from every answer (M. Mahoney,
Adaptive weighing of context models for lossless data compression, 2005). All of it is done in
whole numbers, so that every machine finds the same odds.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Final

import numpy as np

from modalmotion.codec.bits.damage import damaged
from modalmotion.codec.bits.entropy import Coder
from modalmotion.codec.machine.memory import FIRST_WEIGHT

# 256 ln(n + 0.4), rounded.
LOGARITHMS: Final = tuple(
    int(x) for x in np.rint(256.0 * np.log(np.arange(252) + 0.4)).astype(np.int64)
)
LARGEST_LOGIT: Final = 2047
# 65536 / (1 + exp(-d / 256)), rounded, for d = -2047 .. 2047.
CHANCES: Final = tuple(
    int(x)
    for x in np.rint(
        65536.0 / (1.0 + np.exp(-np.arange(-LARGEST_LOGIT, LARGEST_LOGIT + 1) / 256.0))
    ).astype(np.int64)
)
MOST_COUNTED: Final = 250
WIDEST_NUMBER: Final = 40


class Mixer:
    """Code answers, and learn from them.

    Parameters
    ----------
    coder : Writer or Reader
    """

    def __init__(self, coder: Coder) -> None:
        self._coder = coder
        self._counts: dict[Hashable, list[int]] = {}
        self._weights: dict[Hashable, list[int]] = {}

    def bit(self, question: int, contexts: Sequence[Hashable], value: bool | None) -> bool:
        """Code one answer.

        Parameters
        ----------
        question : int
            Which weights are used, and part of every context.
        contexts : sequence
            One for each model; always as many for the same question.
        value : bool, optional
            The answer, for a writer.
        """
        table = self._counts
        seen = []
        for place, context in enumerate(contexts):
            key = (question, place, context)
            counts = table.get(key)
            if counts is None:
                counts = table[key] = [0, 0]
            seen.append(counts)
        weights = self._weights.get(question)
        if weights is None:
            weights = self._weights[question] = [FIRST_WEIGHT] * len(contexts)
        odds = [LOGARITHMS[yes] - LOGARITHMS[no] for no, yes in seen]
        logit = sum(w * x for w, x in zip(weights, odds, strict=True)) >> 16
        logit = max(-LARGEST_LOGIT, min(LARGEST_LOGIT, logit))
        chance = CHANCES[logit + LARGEST_LOGIT]
        answer = self._coder.answer(chance, value)
        surprise = 3 * ((65536 if answer else 0) - chance)
        for place, x in enumerate(odds):
            weights[place] += (x * surprise) >> 16
        for counts in seen:
            _count(counts, answer)
        return answer

    def number(self, question: int, contexts: Sequence[Hashable], value: int | None) -> int:
        """Code a number >= 0: how many bits follow the first of number + 1, then these bits."""
        length = None if value is None else (value + 1).bit_length() - 1
        n = 0
        while self.bit(
            question, [(c, n) for c in contexts], None if length is None else n < length
        ):
            n += 1
            if n > WIDEST_NUMBER:
                raise damaged("A number in the faces does not end.")
        low = None if value is None else value + 1 - (1 << n)
        return (1 << n) - 1 + self.plain(n, low)

    def plain(self, n: int, value: int | None) -> int:
        """Code a number of n bits as it is."""
        values = None if value is None else np.array([value])
        return int(self._coder.bits(np.array([n]), values)[0])


def _count(counts: list[int], answer: bool) -> None:
    """Count an answer, and forget half of what speaks against it."""
    other = counts[not answer]
    counts[answer] += 1
    if other > 2:
        counts[not answer] = (other + 2) // 2
    if counts[0] + counts[1] > MOST_COUNTED:
        counts[0] //= 2
        counts[1] //= 2
