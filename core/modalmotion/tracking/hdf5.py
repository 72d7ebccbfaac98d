"""Tracks as HDF5."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

from modalmotion import errors, notes
from modalmotion.hdf5 import image
from modalmotion.mesh.sequence import TRACK, sequence_datasets, sequence_in
from modalmotion.modes import ModeSet
from modalmotion.template.body_frame import affine_shapes
from modalmotion.template.template import shapes_of, template_datasets, template_in
from modalmotion.tracking import quality_checks, result
from modalmotion.tracking.noise import Noise, Prior

FORM: Final = TRACK

_ARRAYS: Final = {
    "amplitudes": ("{u}", "frame, mode, direction"),
    "covariances": ("{u}^2", "frame, mode direction, mode direction"),
    "deviations": ("{u}", "frame, vertex, normal and tangential"),
    "truncations": ("{u}", "frame"),
    "residuals": ("{u}", "frame, rms and p95"),
    "inliers": ("1", "frame"),
    "coverage": ("1", "frame"),
    "volume_deviations": ("{u}^3", "frame"),
}
_MODES: Final = {"wavenumbers": ("1", "mode, axis"), "is_sine": ("1", "mode")}
_DATA: Final = {
    "points": ("{u}", "point, direction"),
    "weights": ("1", "point"),
    "are_landmarks": ("1", "point"),
    "counts": ("1", "frame"),
}
# For other readers.
_DERIVED: Final = {
    "determined": ("1", "mode, normal and tangential"),
    "volumes": ("{u}^3", "frame"),
}


def track_to_hdf5(track: result.Track) -> bytes:
    """Write a track as a sealed HDF5 file in memory, its sequence and its template included.

    Parameters
    ----------
    track : Track

    Returns
    -------
    bytes
        The same for the same track.
    """
    sequence, template, known = track.sequence, track.template, track.sequence.uncertainty
    unit = sequence.unit
    across = track.covariances if known is None else known.across
    estimate = {
        "prior": asdict(track.prior),
        "noise": asdict(track.noise),
        "reference": track.reference,
        "unseen": track.unseen,
        "volume_correlation": track.volume_correlation,
        "images": None if track.images is None else asdict(track.images),
        "ejection_fraction_percent": track.ejection_fraction,
        "ejection_fraction_bound": track.ejection_fraction_bound,
    }
    datasets = [
        *sequence_datasets(sequence),
        *template_datasets(template, unit, "template_"),
        *image.datasets_of(track, _ARRAYS, unit),
        *image.datasets_of(track, _DERIVED, unit),
        *image.datasets_of(track.modes, _MODES, unit),
        *([] if track.data is None else image.datasets_of(track.data, _DATA, unit, prefix="data_")),
        image.Dataset(
            "across_covariances", across, f"{unit or image.UNKNOWN}^2", _ARRAYS["covariances"][1]
        ),
        image.json_text("estimate", estimate),
        image.json_text("notes", track.notes),
        image.json_text("provenance", dict(track.provenance)),
    ]
    return FORM.image(
        {"sequence_id": sequence.id, "template_id": template.id},
        datasets,
        topology=template.topology.name,
        unit=unit or image.UNKNOWN,
        grid=sequence.grid,
    )


def track_from_hdf5(source: bytes | Path, ids: image.Ids = image.ANY_IDS) -> result.Track:
    """Read a track, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path
    ids : mapping
        Attributes that it must have.

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    with FORM.read(source, ids) as contents:
        return _track_in(contents)


def kept_track(source: Path) -> result.Track | None:
    """Read the track that a file holds; None of other files."""
    if source.suffix.lower() not in (".h5", ".hdf5") or not source.is_file():
        return None
    try:
        is_track = image.form_of(source).kind == FORM.kind
    except errors.StoreError:
        return None
    return track_from_hdf5(source) if is_track else None


def _data_in(contents: image.Contents, sizes: dict[str, int]) -> result.SampledData | None:
    if "data_points" not in contents.arrays:
        return None
    arrays = contents.table(_DATA, sizes, prefix="data_")
    n, counts = len(arrays["points"]), arrays["counts"]
    if counts.min(initial=0) < 0 or counts.sum() != n:
        raise ValueError(f"the frames have {counts.sum()} points, and there are {n}")
    return result.SampledData(**arrays)


def _track_in(contents: image.Contents) -> result.Track:
    """Read the track that the contents of a file hold."""
    sequence, template = sequence_in(contents), template_in(contents, "template_")
    topology = template.topology
    sizes = {"direction": 3, "normal and tangential": 2, "rms and p95": 2}
    sizes |= {"frame": sequence.n_frames, "vertex": sequence.n_vertices, "axis": topology.n_axes}
    modes = ModeSet(topology, **contents.table(_MODES, sizes))
    sizes["mode direction"] = 3 * len(modes)
    arrays = contents.table(_ARRAYS, sizes, optional=("volume_deviations",))
    estimate = contents.json("estimate", dict)
    uncertainty = quality_checks.uncertainty_of(
        template,
        affine_shapes(shapes_of(modes, template), template),
        contents.array("across_covariances", arrays["covariances"].shape),
        arrays["covariances"],
        arrays["truncations"],
        estimate["noise"]["n_values"],
        estimate["reference"],
    )
    sequence = replace(sequence, uncertainty=uncertainty)
    track = result.Track(
        **arrays,
        sequence=sequence,
        template=template,
        modes=modes,
        prior=Prior(**estimate["prior"]),
        noise=Noise(**estimate["noise"]),
        unseen=tuple(estimate["unseen"]),
        volume_correlation=estimate["volume_correlation"],
        reference=estimate["reference"],
        data=_data_in(contents, sizes),
        notes=notes.notes_from_json(contents.json("notes", list)),
        provenance=contents.json("provenance", dict),
        images=None if estimate["images"] is None else result.ImageAnswer(**estimate["images"]),
    )
    return track.informed()
