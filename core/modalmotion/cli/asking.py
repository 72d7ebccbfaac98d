"""Options that say how much of a motion is modelled, shared by commands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click

from modalmotion.choice.parameters import ErrorKind, ModeOrder


def asking_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the ways to ask for modes to a command.

    The command is called with `asked`, which `asked_for` turns into parameters.
    """
    options = [
        click.option("--modes", type=int, help="Modes, 3 amplitudes a frame each.  [default: 7]"),
        click.option("--amplitudes", type=int, help="In place of modes: amplitudes a frame."),
        click.option("--tolerance", type=float, help="Error in mm that is not exceeded."),
        click.option(
            "--tolerance-of",
            type=click.Choice([k.value for k in ErrorKind]),
            default=ErrorKind.RMS.value,
            show_default=True,
            help="RMS over all frames, or the largest of any vertex.",
        ),
        click.option("--tolerance-share", type=float, help="Error as a share of the RMS motion."),
        click.option("--auto", is_flag=True, help="Stop where the residual is noise."),
        click.option(
            "--order",
            type=click.Choice([o.value for o in ModeOrder]),
            default=ModeOrder.FIXED.value,
            show_default=True,
            help="Which modes come first.",
        ),
        click.option(
            "--most-modes", type=int, help="That tolerance, auto and energy may reach to."
        ),
        click.option("--harmonics", type=int, help="Limit each amplitude's path over time."),
    ]
    for option in reversed(options):
        command = option(command)
    return command


ASKED = (
    "modes",
    "amplitudes",
    "tolerance",
    "tolerance_of",
    "tolerance_share",
    "auto",
    "order",
    "most_modes",
    "harmonics",
)
"""Names of these options, which are those of `SignatureParameters`."""


def asked_for(said: dict[str, Any]) -> dict[str, Any]:
    """Take these options out of all that were said, as arguments of `SignatureParameters`."""
    taken = {name: said.pop(name) for name in ASKED}
    taken["tolerance_of"] = ErrorKind(taken["tolerance_of"])
    taken["order"] = ModeOrder(taken["order"])
    return taken
