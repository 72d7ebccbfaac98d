"""Options of commands that track: landmarks, labels and contours."""

from __future__ import annotations

from typing import Final

import click

from modalmotion.cli.options import TRACKING, Grouped, options_of, several
from modalmotion.tracking.parameters import TrackParameters

label_options = options_of(
    TrackParameters, "labels", "wall", "papillary", group=TRACKING, labels={"flag": "label"}
)
tracking_options = several(
    click.option(
        "--landmarks",
        cls=Grouped,
        group=TRACKING,
        multiple=True,
        metavar="NAME[@FRAME]=X,Y,Z|FILE",
        help="Of images, points or contours: place of the apex or the base, in the reference frame "
        "where none is named, or a file of landmarks (ours, or Slicer's .mrk.json); repeat for "
        "more. Label maps need none.",
    ),
    label_options,
    options_of(TrackParameters, "contours", group=TRACKING),
)
"""How what has no corresponding vertices is tracked."""

TRACKING_OPTIONS: Final = ("landmarks", "labels", "wall", "papillary", "contours")
"""Names of these options."""
