"""Options of commands that track: landmarks, labels and contours."""

from __future__ import annotations

from typing import Final

import click

from modalmotion.cli.options import several
from modalmotion.tracking.reading import USUAL_CONTOURS
from modalmotion.tracking.result import CONVENTIONS

label_options = several(
    click.option(
        "--label",
        "labels",
        type=int,
        multiple=True,
        help="Of a label map: value of the cavity. By default that which another label encloses.",
    ),
    click.option("--wall", type=int, multiple=True, help="Of a label map: value of the wall."),
    click.option(
        "--papillary",
        type=click.Choice(CONVENTIONS),
        default="pool",
        show_default=True,
        help="Of images: whether papillary muscles count as cavity.",
    ),
)
tracking_options = several(
    click.option(
        "--landmarks",
        multiple=True,
        metavar="NAME[@FRAME]=X,Y,Z|FILE",
        help="Of images, points or contours: place of the apex or the base, in the reference frame "
        "where none is named, or a file of landmarks (ours, or Slicer's .mrk.json); repeat for "
        "more. Label maps need none.",
    ),
    label_options,
    click.option(
        "--contours",
        multiple=True,
        default=USUAL_CONTOURS,
        show_default=True,
        help="Of typed contours: parts of the names to read.",
    ),
)
"""How what has no corresponding vertices is tracked."""

TRACKING_OPTIONS: Final = ("landmarks", "labels", "wall", "papillary", "contours")
"""Names of these options."""
