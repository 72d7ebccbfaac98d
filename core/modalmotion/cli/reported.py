"""What commands that report have in common: their options, and the report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import (
    components_option,
    merge_option,
    reference_option,
    signature_parameters,
    surface_options,
)
from modalmotion.cli.outputs import OutputFolder
from modalmotion.cli.waiting import Waiting
from modalmotion.signature.making import modal_signature

if TYPE_CHECKING:
    from modalmotion.classification.model.model import Model
    from modalmotion.norm import Norm
    from modalmotion.report import Report

_OPTIONS: Final = (
    sequence_argument,
    click.option("-o", "--out", required=True, type=OutputFolder(), help="Folder to write."),
    click.option("--modes", default=7, show_default=True, help="Modes, 3 amplitudes a frame each."),
    click.option("--model", help="Model: the name of a shipped one, or a file; none by default."),
    click.option(
        "--norm",
        "norm_file",
        type=click.Path(exists=True, path_type=Path),
        help="Norm of your own controls, a file.",
    ),
    click.option(
        "--issued",
        help="Time of the result, as 2026-01-31T12:00:00+00:00; now by default. The same time "
        "gives the same bytes.",
    ),
    surface_options,
    merge_option,
    reference_option,
    components_option,
)


def report_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that name a recording, and what is said of it."""
    return reduce(lambda made, add: add(made), reversed(_OPTIONS), command)


@dataclass(frozen=True)
class Wanted:
    """What a report is to be of, checked before the work.

    Parameters
    ----------
    source : Path
    issued : datetime
    model : Model or None
    norm : Norm or None
    options : dict
        Of reading and of the signature.
    """

    source: Path
    issued: datetime
    model: Model | None
    norm: Norm | None
    options: dict[str, Any]

    @staticmethod
    def of(
        source: Path, model: str | None, norm_file: Path | None, issued: str | None, **options: Any
    ) -> Wanted:
        """Read the options; what is named wrongly is told at once."""
        from modalmotion.cli.model_commands import model_named
        from modalmotion.norm import norm_from_hdf5

        return Wanted(
            source,
            _time(issued),
            None if model is None else model_named(model),
            None if norm_file is None else norm_from_hdf5(norm_file),
            options,
        )

    def report(self, waiting: Waiting) -> Report:
        """Make the report."""
        from modalmotion.classification import classify
        from modalmotion.report import report_of

        parameters = signature_parameters(self.options)
        with waiting.watch.stage("read"):
            sequence = read(self.source, **self.options)
        signature = modal_signature(sequence, parameters, watch=waiting.watch)
        answer = deviation = None
        if self.model is not None:
            with waiting.watch.stage("class"):
                answer = classify(sequence, self.model)
        if self.norm is not None:
            with waiting.watch.stage("controls"):
                deviation = self.norm.deviation(sequence)
        return report_of(
            signature, sequence, issued=self.issued, classification=answer, deviation=deviation
        )


def _time(issued: str | None) -> datetime:
    if issued is None:
        return datetime.now(UTC)
    try:
        return datetime.fromisoformat(issued)
    except ValueError:
        raise click.BadParameter(
            f"{issued!r} is no time; write it as 2026-01-31T12:00:00+00:00.",
            param_hint="--issued",
        ) from None
