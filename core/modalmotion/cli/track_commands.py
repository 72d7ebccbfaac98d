"""Commands that track a surface through frames of any kind, and segment one image."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
import numpy as np

from modalmotion.cli.options import (
    MOVING,
    PICTURES,
    TRACKING,
    Grouped,
    OutputFile,
    command,
    json_option,
    options_of,
    output_option,
    plot_option,
    several,
    tell,
    write_picture,
)
from modalmotion.errors import ParameterError
from modalmotion.formats import read_sequence, write_npz
from modalmotion.formats.ply import write_ply
from modalmotion.formats.volumes import read_images
from modalmotion.images import ImageSequence
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
from modalmotion.tracking.making import segment as segment_image
from modalmotion.tracking.parameters import USUAL_MODES, TrackParameters
from modalmotion.tracking.reading import Recorded, read_observed, recorded_images

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


# mm^3 in one ml.
_MM3_PER_ML = 1000.0


@command("segment labels.nii.gz -o lv.ply")
@click.argument("source", metavar="IN", type=click.Path(exists=True, path_type=Path))
@output_option(
    "File to write: the surface with its deviations (.ply), the surface (.npz), or all (.h5).",
    ".ply",
    ".npz",
    ".h5",
    ".hdf5",
)
@click.option(
    "--landmarks",
    multiple=True,
    metavar="NAME=X,Y,Z|FILE",
    help="Place of the apex or the base in LPS mm, or a file of landmarks; once for each.",
)
@label_options
@click.option("--frame", default=0, show_default=True, help="Of images over time.")
@click.option(
    "--start", type=click.Path(exists=True, path_type=Path), help="A surface to start from."
)
@click.option("--modes", default=USUAL_MODES, show_default=True, help="Three amplitudes each.")
@plot_option
@json_option
def segment(
    source: Path,
    output: Path,
    landmarks: tuple[str, ...],
    start: Path | None,
    plot: Path | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Segment one image of IN by a surface, with its standard deviation.

    IN is NIfTI, NRRD, MetaImage, or a folder or zip of DICOM. The surface is fitted to the edge
    around the axis from apex to base; --plot shows it over slices.
    """
    images = read_images(source)
    marks = stated_landmarks(landmarks, recorded_images(images), None, options["frame"])
    surface = None if start is None else read_sequence(start).sequence
    result = segment_image(images, landmarks=marks, start=surface, **options)
    write_atomic(output, _written(result, output.suffix.lower()))
    if plot is not None:
        shown = ImageSequence((images.frames[options["frame"]],))
        write_picture(overlay_figure(result, shown), plot)
    numbers = _numbers_of_segment(result)
    bound = 2 * numbers["volume_deviation_ml"]
    muscles = f"papillary muscles counted as {options['papillary']}"
    lines = [
        f"volume {numbers['volume_ml']:.1f} ml +- {bound:.1f}, {muscles}",
        f"stated error {numbers['deviation_across']:.2g} mm across the surface",
        *(f"note: {note}" for note in result.notes),
    ]
    tell(numbers, lines, output, plot, as_json=as_json)


def _written(result: Track, suffix: str) -> bytes:
    if suffix == ".ply":
        deviations = {
            "deviation_across": result.deviations[0, :, 0],
            "deviation_along": result.deviations[0, :, 1],
        }
        states = {"unit": "mm", "coordinate_system": "LPS"}
        return write_ply(
            result.sequence.vertices[0].astype("f8"), result.template.faces, states, deviations
        )
    return write_npz(result.sequence) if suffix == ".npz" else track_to_hdf5(result)


def _numbers_of_segment(result: Track) -> dict[str, Any]:
    volumes, deviations, images = result.volumes, result.volume_deviations, result.images
    # An image is segmented by a surface that encloses a volume.
    assert volumes is not None  # noqa: S101
    assert deviations is not None  # noqa: S101
    assert images is not None  # noqa: S101
    return {
        "volume_ml": float(volumes[0]) / _MM3_PER_ML,
        "volume_deviation_ml": float(deviations[0]) / _MM3_PER_ML,
        "deviation_across": float((result.deviations[0, :, 0] ** 2).mean() ** 0.5),
        "found": images.found[0],
        "papillary": images.papillary,
        "papillary_volume_ml": images.papillary_volume / _MM3_PER_ML,
        "notes": list(result.notes),
    }
