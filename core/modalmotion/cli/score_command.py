"""Command that compares an estimated motion with the true one."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click

from modalmotion.cli.options import command, json_option
from modalmotion.clinical.score import PUBLISHED
from modalmotion.clinical.score import score as scored
from modalmotion.formats import read_sequence
from modalmotion.formats.npz import read_arrays
from modalmotion.tracking.hdf5 import track_from_hdf5


@command("score truth.npz answer.h5")
@click.argument("truth", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.argument("answer", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@json_option
def score(truth: Path, answer: Path, as_json: bool) -> None:
    """Compare the motion in ANSWER with the true one in TRUTH.

    ANSWER is a track (.h5), with its deviations, or a sequence in any format; .npz may contain
    `deviations` (frames, vertices), mm.
    """
    deviations = None
    if answer.suffix.lower() in (".h5", ".hdf5"):
        found = track_from_hdf5(answer.read_bytes())
        estimated, deviations = found.sequence, found.deviations[:, :, 0]
    else:
        estimated = read_sequence(answer).sequence
        if answer.suffix.lower() == ".npz":
            arrays, _ = read_arrays(answer.read_bytes(), ["deviations"], [])
            deviations = arrays.get("deviations")
    result = scored(read_sequence(truth).sequence, estimated, deviations)
    if as_json:
        click.echo(json.dumps(asdict(result), indent=2))
        return
    inside = "not stated"
    if result.inside is not None:
        inside = f"{100 * result.inside:.0f} % (mean stated deviation {result.stated:.2f} mm)"
    click.echo(
        f"end-point error of 12 landmarks: {result.end_point_end_systole:.2f} mm at end systole, "
        f"{result.end_point:.2f} mm over all frames\n"
        f"distance along the normal: {result.along_normal:.2f} mm\n"
        f"error of EF {result.ejection_fraction:+.1f}, GLS {result.gls:+.1f}, "
        f"GCS {result.gcs:+.1f} percentage points\n"
        f"within 1.96 stated deviations: {inside}\n"
        f"Published end-point errors: {PUBLISHED} mm. They are of other recordings and landmarks, "
        "and compare with end-point errors only: distances along the normal do not see motion "
        "within the surface and are smaller."
    )
