"""Options and report of the commands that report."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import fit_options, several, signature_parameters
from modalmotion.cli.stated_facts import stated_facts
from modalmotion.cli.tracking_options import TRACKING_OPTIONS, tracking_options
from modalmotion.cli.waiting import Waiting
from modalmotion.signature.making import modal_signature

if TYPE_CHECKING:
    from modalmotion.mesh.sequence import MeshSequence
    from modalmotion.norm import Norm
    from modalmotion.reports import Report

report_options = several(
    sequence_argument,
    click.option("--model", help="Model: the name of an included one, or a file; none by default."),
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
    tracking_options,
    fit_options,
)
"""Source of a recording, and its options."""


@dataclass(frozen=True)
class Wanted:
    """Source and options of a report, checked before the work.

    Parameters
    ----------
    source : Path
    issued : datetime
    model : str or None
    norm : Norm or None
    tracking : dict
        Landmarks, labels, wall, contours and papillary convention of what is tracked first.
    options : dict
        Of reading and of the signature.
    """

    source: Path
    issued: datetime
    model: str | None
    norm: Norm | None
    tracking: dict[str, Any]
    options: dict[str, Any]

    @staticmethod
    def of(
        source: Path,
        model: str | None,
        norm_file: Path | None,
        issued: str | None,
        **options: Any,
    ) -> Wanted:
        """Read the options, and refuse wrong ones at once."""
        from modalmotion.cli.model_commands import model_named
        from modalmotion.norm import norm_from_hdf5

        if model is not None:
            model_named(model)
        norm = None if norm_file is None else norm_from_hdf5(norm_file)
        tracking = {name: options.pop(name) for name in TRACKING_OPTIONS}
        return Wanted(source, _time(issued), model, norm, tracking, options)

    def report(self, waiting: Waiting) -> Report:
        """Make the report."""
        from modalmotion.classification import classify, shipped_for
        from modalmotion.cli.model_commands import model_named
        from modalmotion.reports import report_of

        parameters = signature_parameters(self.options)
        sequence = self._sequence(waiting)
        signature = modal_signature(sequence, parameters, watch=waiting.watch)
        answer = deviation = None
        if self.model is not None:
            with waiting.watch.stage("class"):
                # Of the included models the one for the kind of points.
                answer = classify(sequence, model_named(shipped_for(self.model, sequence.facts)))
        if self.norm is not None:
            with waiting.watch.stage("controls"):
                deviation = self.norm.deviation(sequence)
        return report_of(
            signature, sequence, issued=self.issued, classification=answer, deviation=deviation
        )

    def _sequence(self, waiting: Waiting) -> MeshSequence:
        """Read the sequence, or track one through images, points or contours."""
        from modalmotion.formats.volumes.reading import holds_images
        from modalmotion.tracking.reading import holds_contours, read_observed

        with waiting.watch.stage("read"):
            named = dict(self.tracking)
            landmarks, contours = named.pop("landmarks"), named["contours"]
            is_stated = bool(landmarks or named["labels"])
            if not (is_stated or holds_images(self.source) or holds_contours(self.source)):
                return read(self.source, **self.options)
            from modalmotion.cli.track_command import stated_landmarks
            from modalmotion.tracking.parameters import TrackParameters

            recorded = read_observed(self.source, contours=contours)
            unit = self.options["unit"]
            marks = stated_landmarks(landmarks, recorded, unit)
        with waiting.watch.stage("track"):
            parameters = TrackParameters(
                landmarks=marks,
                unit=unit,
                times=self.options["frame_interval"],
                facts=stated_facts(dict(self.options)),
                **named,
            )
            return parameters.follow(recorded).sequence


def _time(issued: str | None) -> datetime:
    if issued is None:
        return datetime.now(UTC)
    try:
        return datetime.fromisoformat(issued)
    except ValueError:
        raise click.BadParameter(
            f"{issued!r} is not a time; write it as 2026-01-31T12:00:00+00:00.",
            param_hint="--issued",
        ) from None
