"""Commands that track a surface through frames of any kind, and segment one image."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import click
import numpy as np

from modalmotion import errors, formats, notes, store, tracking
from modalmotion.cli import shared
from modalmotion.cli.files import Waiting, counting, naming, read, stated_facts
from modalmotion.formats import ply
from modalmotion.formats.volumes import read_images
from modalmotion.formats.volumes.reading import holds_images
from modalmotion.images import ImageSequence
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.pictures.track import (
    data_figure,
    determined_figure,
    deviations_figure,
    overlay_figure,
    overlay_gif,
    usual_frame,
)
from modalmotion.progress import Reporter
from modalmotion.signature.making import ModalSignature, modal_signature
from modalmotion.tracking import hdf5
from modalmotion.tracking.landmarks import read_landmark_file
from modalmotion.tracking.parameters import USUAL_MODES, TrackParameters
from modalmotion.tracking.reading import Recorded, holds_contours, read_observed, recorded_images
from modalmotion.tracking.recordings import segment as segment_image
from modalmotion.tracking.recordings import track as track_recorded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

label_options = shared.options_of(
    TrackParameters, "labels", "papillary", group=shared.TRACKING, labels={"flag": "label"}
)
start_option = click.option(
    "--start",
    cls=shared.Grouped,
    group=shared.TRACKING,
    type=shared.EXISTING,
    help="File of the surface to start from.",
)
tracking_options = shared.several(
    click.option(
        "--landmarks",
        cls=shared.Grouped,
        group=shared.TRACKING,
        multiple=True,
        metavar="NAME[@FRAME]=X,Y,Z|FILE",
        help="Of images, points or contours: place of the apex or the base, in the reference frame "
        "where none is named, or a file of landmarks (ours, or Slicer's .mrk.json); repeat for "
        "more. Label maps need none.",
    ),
    label_options,
    start_option,
    shared.options_of(TrackParameters, "time", group=shared.TRACKING),
)
"""How what has no corresponding vertices is tracked."""

_TRACKING: Final = ("landmarks", "labels", "papillary", "start", "time")


def fitted_recording(
    source: Path, waiting: Waiting, options: dict[str, Any]
) -> tuple[MeshSequence, ModalSignature]:
    """Read a sequence, or track one through images, points or contours; and fit its signature.

    Parameters
    ----------
    source : Path
    waiting : Waiting
    options : dict
        Of `tracking_options`, `sequence_argument` and `fit_options`.
    """
    named = {name: options.pop(name) for name in _TRACKING}
    parameters = shared.signature_parameters(options)
    with waiting.watch.stage("read"):
        is_stated = named["landmarks"] or named["labels"]
        is_tracked = is_stated or holds_images(source) or holds_contours(source)
        if is_tracked:
            with naming(source):
                recorded = read_observed(source, labels=named["labels"])
        else:
            sequence = read(source, **options)
    if is_tracked:
        with waiting.watch.stage("track"):
            stated = {"unit": options["unit"], "times": options["frame_interval"]}
            facts = stated_facts(options)
            sequence = _followed(recorded, named, **stated, facts=facts).sequence
    return sequence, modal_signature(sequence, parameters, watch=waiting.watch)


def _followed(
    recorded: Recorded, named: dict[str, Any], progress: Reporter | None = None, **stated: Any
) -> tracking.Track:
    landmarks, start = named.pop("landmarks"), named.pop("start")
    marks = stated_landmarks(landmarks, recorded, stated["unit"], stated.get("reference", 0))
    surface = None if start is None else read(start)
    return track_recorded(
        recorded, start=surface, progress=progress, landmarks=marks, **named, **stated
    )


@shared.command("track frames/ -o beat.npz --landmarks apex=1,2,3 --unit mm")
@click.argument("source", metavar="IN", type=shared.EXISTING)
@tracking_options
@shared.options_of(TrackParameters, "topology", "modes", "reference", "unit")
def track(
    source: Path,
    output: Annotated[Path, shared.OutputFile(".npz", ".h5", ".hdf5")],
    times: Annotated[float | None, {"flag": "frame-interval"}] = None,
    plot: Annotated[Path | None, shared.OutputFile(*shared.PICTURES, shared.MOVING)] = None,
    picture: Literal["data", "deviations", "determined"] = "data",
    **options: Any,
) -> Any:
    """Track a surface through the frames in IN, without correspondence between them.

    IN is a folder or zip with one mesh, cloud or set of contours per frame, an npz of points and
    offsets, or images: NIfTI, NRRD, MetaImage, or a folder or zip of DICOM. The motion follows the
    data along the surface's normals.

    Parameters
    ----------
    output
        File to write: the sequence (.npz), or the whole track (.h5).
    times
        Seconds from frame to frame.
    plot
        Picture to write (.png, .svg, .pdf); for images also a .gif of all frames.
    picture
        Of --plot: data over the surface by frame, the stated error on it, or what the data
        have set.
    """
    named = {name: options.pop(name) for name in _TRACKING}
    with counting("frames") as progress:
        with naming(source):
            recorded = read_observed(source, labels=named["labels"])
        if plot is not None and plot.suffix.lower() == shared.MOVING:
            _require_images(recorded, picture)
        result = _followed(recorded, named, progress, times=times, **options)
    is_npz = output.suffix.lower() == ".npz"
    store.write_atomic(
        output, formats.write_npz(result.sequence) if is_npz else hdf5.track_to_hdf5(result)
    )
    if plot is not None and plot.suffix.lower() == shared.MOVING and recorded.images is not None:
        store.write_atomic(plot, overlay_gif(result, recorded.images))
    elif plot is not None:
        shared.write_picture(_figure(result, recorded, picture), plot)
    return _numbers(result)


def _require_images(recorded: Recorded, picture: str) -> None:
    """Refuse a moving picture of what has none, before any work."""
    if recorded.images is None or picture != "data":
        raise errors.ParameterError(
            "A .gif is available only for contours over images.",
            remedy="Name a .png, or track images with --picture data.",
        )


def _figure(result: tracking.Track, recorded: Recorded, picture: str) -> Figure:
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
            with naming(path):
                file = read_landmark_file(path.read_bytes())
                marks |= file.for_points(recorded.coordinates, unit or recorded.unit)
            continue
        name, _, place = text.partition("=")
        name, _, frame = name.partition("@")
        try:
            x, y, z = (float(part) for part in place.split(","))
            k = int(frame or reference)
        except ValueError:
            raise errors.ParameterError(
                f"The landmark {text[:60]!r} is neither NAME=X,Y,Z nor a file.",
                remedy="Write --landmarks apex=1,2,3, or base@8=1,2,3 for frame 8, or "
                "--landmarks FILE.mrk.json.",
            ) from None
        if not 0 <= k < recorded.n_frames:
            raise errors.ParameterError(
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


def _numbers(result: tracking.Track) -> dict[str, object]:
    return {
        **shared.members(result, "sequence.id as sequence_id", "n_frames as frames"),
        "modes": len(result.modes),
        **shared.members(result, "template.topology.name as topology", "sequence.unit"),
        "noise": result.noise.sd,
        "deviation_across": float(np.median(result.deviations[:, :, 0])),
        "deviation_along": float(np.median(result.deviations[:, :, 1])),
        "residual_rms": [None if np.isnan(r) else r for r in result.residuals[:, 0].tolist()],
        **shared.members(result, "inliers", "coverage", "unseen", "determined", "notes"),
        **shared.members(
            result, "ejection_fraction", "ejection_fraction_bound", "ejection_fractions"
        ),
        "papillary": None if result.images is None else result.images.papillary,
    }


# mm^3 in one ml.
_MM3_PER_ML = 1000.0


@shared.command("segment labels.nii.gz -o lv.ply")
@click.argument("source", metavar="IN", type=shared.EXISTING)
@label_options
@start_option
def segment(
    source: Path,
    start: Path | None,
    output: Annotated[Path, shared.OutputFile(".ply", ".npz", ".h5", ".hdf5")],
    landmarks: Annotated[tuple[str, ...], {"metavar": "NAME=X,Y,Z|FILE"}] = (),
    frame: int = 0,
    modes: int = USUAL_MODES,
    plot: shared.Plot = None,
    **options: Any,
) -> Any:
    """Segment one image of IN by a surface, with its standard deviation.

    IN is NIfTI, NRRD, MetaImage, or a folder or zip of DICOM. The surface is fitted to the edge
    around the axis from apex to base; --plot shows it over slices.

    Parameters
    ----------
    output
        File to write: the surface with its deviations (.ply), the surface (.npz), or all
        (.h5).
    landmarks
        Place of the apex or the base in LPS mm, or a file of landmarks; once for each.
    frame
        Of images over time.
    modes
        Three amplitudes each.
    plot
        Picture to write (.png, .svg, .pdf).
    """
    with naming(source):
        images = read_images(source)
    marks = stated_landmarks(landmarks, recorded_images(images), None, frame)
    surface = None if start is None else read(start)
    result = segment_image(
        images, landmarks=marks, start=surface, frame=frame, modes=modes, **options
    )
    store.write_atomic(output, _written(result, output.suffix.lower()))
    if plot is not None:
        shown = ImageSequence((images.frames[frame],))
        shared.write_picture(overlay_figure(result, shown), plot)
    volumes, deviations, found = result.volumes, result.volume_deviations, result.images
    # An image is segmented by a surface that encloses a volume.
    assert volumes is not None  # noqa: S101
    assert deviations is not None  # noqa: S101
    assert found is not None  # noqa: S101
    return {
        "volume_ml": float(volumes[0]) / _MM3_PER_ML,
        "volume_deviation_ml": float(deviations[0]) / _MM3_PER_ML,
        "deviation_across": float((result.deviations[0, :, 0] ** 2).mean() ** 0.5),
        "found": found.found[0],
        "papillary": found.papillary,
        "papillary_volume_ml": found.papillary_volume / _MM3_PER_ML,
        "notes": notes.notes_as_json(result.notes),
    }


def _written(result: tracking.Track, suffix: str) -> bytes:
    if suffix == ".ply":
        deviations = {
            "deviation_across": result.deviations[0, :, 0],
            "deviation_along": result.deviations[0, :, 1],
        }
        states = {"unit": "mm", "coordinate_system": "LPS"}
        return ply.write_ply(
            result.sequence.vertices[0].astype("f8"), result.template.faces, states, deviations
        )
    return formats.write_npz(result.sequence) if suffix == ".npz" else hdf5.track_to_hdf5(result)
