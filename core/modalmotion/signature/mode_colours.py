"""A colour and a dash for each mode: fixed by its label, wherever it is drawn."""

from __future__ import annotations

from typing import Final

from modalmotion.modes.topology import ModeLabel

# Distinct for colour-blind readers too (Okabe and Ito, Color Universal Design, 2008).
COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#6A51A3")
"""Of labels, in the order of `mode_tone`."""

DASHES: Final = ((), (7, 2.5), (2, 2), (8, 2, 2, 2), (4, 2), (8, 2, 2, 2, 2, 2))
"""Lengths of lines and gaps, in points: colours are told apart without seeing them."""


def mode_tone(label: ModeLabel) -> int:
    """Give the number of a label: by the sum of its wavenumbers, then by the later ones.

    A cosine and its sine have one number: (0, 0) 0, (1, 0) 1, (0, 1) 2, (2, 0) 3, (1, 1) 4.
    """
    *before, number = map(abs, label.wavenumbers)
    for p in reversed(before):
        # Cantor's pairing: every pair once.
        total = p + number
        number += total * (total + 1) // 2
    # A wave that runs backwards is three colours away.
    return number + 3 * (min(label.wavenumbers) < 0)


def mode_colour(label: ModeLabel) -> str:
    """Give the colour of a mode, as #rrggbb."""
    return COLOURS[mode_tone(label) % len(COLOURS)]


def mode_dash(label: ModeLabel) -> tuple[float, ...]:
    """Give the dash of a mode: with its colour it is that of no other among 36."""
    tone = mode_tone(label)
    return DASHES[(tone + tone // len(COLOURS)) % len(DASHES)]
