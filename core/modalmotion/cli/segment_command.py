"""Command that finds a surface in one image."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from modalmotion.cli.options import command, json_option, output_option, plot_option, tell
from modalmotion.cli.outputs import write_picture
from modalmotion.cli.track_command import stated_landmarks
from modalmotion.cli.tracking_options import label_options
from modalmotion.formats import read_sequence, write_npz
from modalmotion.formats.ply import write_ply
from modalmotion.formats.volumes import read_images
from modalmotion.images import ImageSequence
from modalmotion.pictures.track import overlay_figure
from modalmotion.store import write_atomic
from modalmotion.tracking import Track
from modalmotion.tracking.hdf5 import track_to_hdf5
from modalmotion.tracking.making import segment as segment_image
from modalmotion.tracking.parameters import USUAL_MODES
from modalmotion.tracking.reading import recorded_images

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
    numbers = _numbers(result)
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


def _numbers(result: Track) -> dict[str, Any]:
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
