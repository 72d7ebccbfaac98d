"""Command that tracks a surface through clouds, contours or changing meshes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
import numpy as np

from modalmotion.cli.options import command, json_option, options_of, output_option, tell
from modalmotion.cli.outputs import MOVING, PICTURES, OutputFile, write_picture
from modalmotion.cli.tracking_options import tracking_options
from modalmotion.errors import ParameterError
from modalmotion.formats import read_sequence, write_npz
from modalmotion.pictures.track import (
    data_figure,
    determined_figure,
    deviations_figure,
    overlay_figure,
    overlay_gif,
    usual_frame,
)
from modalmotion.representation import numeral
from modalmotion.store import write_atomic
from modalmotion.tracking import Track
from modalmotion.tracking.hdf5 import track_to_hdf5
from modalmotion.tracking.landmarks import read_landmark_file
from modalmotion.tracking.parameters import TrackParameters
from modalmotion.tracking.reading import Recorded, read_observed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_PICTURES: Final = ("data", "deviations", "determined")


@command("track frames/ -o beat.npz --landmarks apex=1,2,3 --unit mm")
@click.argument("source", metavar="IN", type=click.Path(exists=True, path_type=Path))
@output_option(
    "File to write: the sequence (.npz), or the whole track (.h5).", ".npz", ".h5", ".hdf5"
)
@tracking_options
@click.option(
    "--start", type=click.Path(exists=True, path_type=Path), help="A surface to start from."
)
@options_of(TrackParameters, "topology", "modes", "time", "reference", "unit")
@click.option("--frame-interval", "times", type=float, help="Seconds from frame to frame.")
@click.option(
    "--plot",
    type=OutputFile(*PICTURES, MOVING),
    help="Picture to write (.png, .svg, .pdf); for images also a .gif of all frames.",
)
@click.option(
    "--picture",
    type=click.Choice(_PICTURES),
    default="data",
    show_default=True,
    help="Of --plot: data over the surface by frame, the stated error on it, or what the data have "
    "set.",
)
@json_option
def track(
    source: Path,
    output: Path,
    landmarks: tuple[str, ...],
    start: Path | None,
    contours: tuple[str, ...],
    plot: Path | None,
    picture: str,
    as_json: bool,
    **options: Any,
) -> None:
    """Track a surface through the frames in IN, without correspondence between them.

    IN is a folder or zip with one mesh, cloud or set of contours per frame, an npz of points and
    offsets, or images: NIfTI, NRRD, MetaImage, or a folder or zip of DICOM. The motion follows the
    data along the surface's normals.
    """
    with click.progressbar(length=1, label="frames", file=sys.stderr) as bar:

        def shown(done: int, total: int) -> None:
            bar.length = total
            bar.update(done - bar.pos)

        recorded = read_observed(source, contours=contours)
        if plot is not None and plot.suffix.lower() == MOVING:
            _require_images(recorded, picture)
        marks = stated_landmarks(landmarks, recorded, options["unit"], options["reference"])
        parameters = TrackParameters(contours=contours, landmarks=marks, **options)
        surface = None if start is None else read_sequence(start).sequence
        result = parameters.follow(recorded, start=surface, progress=shown)
    is_npz = output.suffix.lower() == ".npz"
    data = write_npz(result.sequence) if is_npz else track_to_hdf5(result)
    write_atomic(output, data)
    if plot is not None and plot.suffix.lower() == MOVING and recorded.images is not None:
        write_atomic(plot, overlay_gif(result, recorded.images))
    elif plot is not None:
        write_picture(_figure(result, recorded, picture), plot)
    notes = [f"note: {note}" for note in result.notes]
    tell(_numbers(result), [*_lines(result), *notes], output, plot, as_json=as_json)


def _require_images(recorded: Recorded, picture: str) -> None:
    """Refuse a moving picture of what has none, before any work."""
    if recorded.images is None or picture != _PICTURES[0]:
        raise ParameterError(
            "A .gif is available only for contours over images.",
            remedy="Name a .png, or track images with --picture data.",
        )


def _figure(result: Track, recorded: Recorded, picture: str) -> Figure:
    if picture == "deviations":
        return deviations_figure(result, usual_frame(result))
    if picture == "determined":
        return determined_figure(result)
    if recorded.images is not None:
        return overlay_figure(result, recorded.images)
    return data_figure(result)


def stated_landmarks(
    texts: Sequence[str], recorded: Recorded, unit: str | None, reference: int = 0
) -> dict[str, Any]:
    """Read landmarks: NAME=X,Y,Z, NAME@FRAME=X,Y,Z, or a file of some.

    Raises
    ------
    ParameterError
        If one is none of these, or its frame is not there.
    """
    marks: dict[str, Any] = {}
    for text in texts:
        path = Path(text)
        if path.is_file():
            file = read_landmark_file(path.read_bytes())
            marks |= file.for_points(recorded.coordinates, unit or recorded.unit)
            continue
        name, _, place = text.partition("=")
        name, _, frame = name.partition("@")
        try:
            x, y, z = (float(part) for part in place.split(","))
            k = int(frame or reference)
        except ValueError:
            raise ParameterError(
                f"The landmark {text[:60]!r} is neither NAME=X,Y,Z nor a file.",
                remedy="Write --landmarks apex=1,2,3, or base@8=1,2,3 for frame 8, or "
                "--landmarks FILE.mrk.json.",
            ) from None
        if not 0 <= k < recorded.n_frames:
            raise ParameterError(
                f"The landmark {text[:60]!r} is of frame {k}; there are {recorded.n_frames}.",
                remedy="Name a frame, counted from 0.",
                frame=k,
            )
        known = np.asarray(marks.get(name, np.nan))
        rows = np.full((recorded.n_frames, 3), np.nan)
        rows[:] = known if known.ndim == 2 else np.nan
        rows[k] = x, y, z
        marks[name] = rows
    return marks


def _lines(result: Track) -> list[str]:
    unit = result.sequence.unit or "length units"
    seen = result.residuals[np.isfinite(result.residuals[:, 0]), 0]
    across, along = np.median(result.deviations, axis=(0, 1))
    lines = [
        (
            f"{result.n_frames} frames in {len(result.modes)} modes of a "
            f"{result.template.topology.name}; {len(result.unseen)} without points"
        ),
        f"residual RMS {numeral(float(seen.mean()), 2)} {unit}, noise {result.noise.sd:.3g} {unit}",
        f"stated error {across:.2g} {unit} across the surface, {along:.2g} {unit} along it",
    ]
    if result.ejection_fraction is not None and result.ejection_fraction_bound is not None:
        bound = result.ejection_fraction_bound
        lines.append(f"volume change {result.ejection_fraction:.1f} % +- {bound:.1f}")
    if result.images is not None:
        both = ", ".join(
            f"{value:.1f} % ({name})" for name, value in result.ejection_fractions.items()
        )
        lines.append(f"papillary muscles counted as {result.images.papillary}: {both}")
    if result.gap is not None:
        lines.append(f"forward and backward tracking agree to {result.gap:.2g} {unit}")
    return lines


def _numbers(result: Track) -> dict[str, object]:
    return {
        "sequence_id": result.sequence.id,
        "frames": result.n_frames,
        "modes": len(result.modes),
        "topology": result.template.topology.name,
        "unit": result.sequence.unit,
        "noise": result.noise.sd,
        "residual_rms": [None if np.isnan(r) else r for r in result.residuals[:, 0].tolist()],
        "inliers": result.inliers.tolist(),
        "coverage": result.coverage.tolist(),
        "unseen": list(result.unseen),
        "gap": result.gap,
        "determined": result.determined.tolist(),
        "ejection_fraction": result.ejection_fraction,
        "ejection_fraction_bound": result.ejection_fraction_bound,
        "ejection_fractions": result.ejection_fractions,
        "papillary": None if result.images is None else result.images.papillary,
        "notes": list(result.notes),
    }
