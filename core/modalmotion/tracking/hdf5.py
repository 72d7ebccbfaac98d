"""Tracks as HDF5."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion import errors, notes
from modalmotion.hdf5.image import UNKNOWN, Contents, Dataset, form_of, json_text
from modalmotion.mesh.sequence import TRACK, sequence_datasets, sequence_in
from modalmotion.modes import ModeSet
from modalmotion.template.body_frame import affine_shapes
from modalmotion.template.template import shapes_of, template_datasets, template_in
from modalmotion.tracking import quality_checks, result
from modalmotion.tracking.noise import Noise, Prior

FORM: Final = TRACK

# Arrays of a track and of its template: power of the length unit, and axes.
_TRACK: Final = {
    "amplitudes": (1, "frame, mode, direction"),
    "covariances": (2, "frame, mode direction, mode direction"),
    "deviations": (1, "frame, vertex, normal and tangential"),
    "truncations": (1, "frame"),
    "residuals": (1, "frame, rms and p95"),
    "inliers": (0, "frame"),
    "coverage": (0, "frame"),
}

# Name of the template's vertices: "vertices" are those of the frames.
_SHAPE: Final = "reference_vertices"

_MODES: Final = {"wavenumbers": (0, "mode, axis"), "is_sine": (0, "mode")}
_DATA: Final = {
    "points": (1, "point, direction"),
    "weights": (0, "point"),
    "are_landmarks": (0, "point"),
    "counts": (0, "frame"),
}

_SIZES: Final = {"direction": 3, "corner": 3, "normal and tangential": 2, "rms and p95": 2}


def _written(
    owner: object, table: Mapping[str, tuple[int, str]], unit: str, prefix: str = ""
) -> list[Dataset]:
    """Datasets of the arrays of a table; truth values and whole numbers in one width."""
    made = []
    for name, (power, axes) in table.items():
        array = np.asarray(getattr(owner, name))
        kind = {"b": "u1", "i": "<i8"}.get(array.dtype.kind)
        units = {0: "1", 1: unit}.get(power, f"{unit}^{power}")
        array = array if kind is None else array.astype(kind, copy=False)
        made.append(Dataset(prefix + name, array, units, axes))
    return made


def _read(
    contents: Contents,
    table: Mapping[str, tuple[int, str]],
    sizes: Mapping[str, int],
    prefix: str = "",
) -> dict[str, Any]:
    """Arrays of a table, of the shapes that their axes say."""
    return {
        name: contents.array(
            prefix + name,
            tuple({**_SIZES, **sizes}.get(axis) for axis in axes.split(", ")),
        )
        for name, (_, axes) in table.items()
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
    unit = sequence.unit or UNKNOWN
    across = track.covariances if known is None else known.across
    estimate = {
        "prior": asdict(track.prior),
        "noise": asdict(track.noise),
        "reference": track.reference,
        "volume_correlation": track.volume_correlation,
        "images": None if track.images is None else asdict(track.images),
        "ejection_fraction_percent": track.ejection_fraction,
        "ejection_fraction_bound": track.ejection_fraction_bound,
    }
    datasets = [
        *sequence_datasets(sequence),
        *template_datasets(template, unit, _SHAPE),
        *_written(track, _TRACK, unit),
        *_written(track.modes, _MODES, unit),
        *([] if track.data is None else _written(track.data, _DATA, unit, "data_")),
        Dataset("across_covariances", across, f"{unit}^2", _TRACK["covariances"][1]),
        Dataset("determined", track.determined, "1", "mode, normal and tangential"),
        Dataset("unseen", np.array(track.unseen, dtype="<i8"), "1", "frame"),
        json_text("estimate", estimate),
        json_text("notes", track.notes),
        json_text("provenance", dict(track.provenance)),
    ]
    if track.volumes is not None and track.volume_deviations is not None:
        datasets.append(Dataset("volumes", track.volumes, f"{unit}^3", "frame"))
        datasets.append(Dataset("volume_deviations", track.volume_deviations, f"{unit}^3", "frame"))
    return FORM.image(
        {"sequence_id": sequence.id, "template_id": template.id},
        datasets,
        topology=template.topology.name,
        unit=unit,
        grid=sequence.grid,
    )


def track_from_hdf5(source: bytes | Path) -> result.Track:
    """Read a track, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    return read_track(source)[0]


def read_track(source: bytes | Path) -> tuple[result.Track, Contents]:
    """Read a track, and the contents of its file besides.

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    with FORM.read(source) as contents:
        return _track_in(contents), contents


def kept_track(source: Path) -> result.Track | None:
    """Read the track that a file holds; None of other files."""
    if source.suffix.lower() not in (".h5", ".hdf5") or not source.is_file():
        return None
    try:
        is_track = form_of(source).kind == FORM.kind
    except errors.StoreError:
        return None
    return track_from_hdf5(source) if is_track else None


def _data_in(contents: Contents, sizes: Mapping[str, int]) -> result.SampledData | None:
    if "data_points" not in contents.arrays:
        return None
    arrays = _read(
        contents, _DATA, {**sizes, "point": len(contents.arrays["data_points"])}, "data_"
    )
    n, counts = len(arrays["points"]), arrays["counts"]
    if counts.min(initial=0) < 0 or counts.sum() != n:
        raise ValueError(f"the frames have {counts.sum()} points, and there are {n}")
    arrays["are_landmarks"] = arrays["are_landmarks"].astype(np.bool_)
    return result.SampledData(**arrays)


def _track_in(contents: Contents) -> result.Track:
    """Read the track that the contents of a file hold."""
    sequence, template = sequence_in(contents), template_in(contents, _SHAPE)
    (f, v, _), m = sequence.vertices.shape, len(contents.array("wavenumbers", (None, None)))
    topology = template.topology
    sizes = {"frame": f, "mode": m, "vertex": v, "axis": topology.n_axes, "mode direction": 3 * m}
    estimate = contents.json("estimate", dict)
    has_volumes = "volume_deviations" in contents.arrays
    found = _read(contents, _MODES, sizes)
    modes = ModeSet(topology, found["wavenumbers"], found["is_sine"].astype(np.bool_))
    arrays = _read(contents, _TRACK, sizes)
    uncertainty = quality_checks.uncertainty_of(
        template,
        affine_shapes(shapes_of(modes, template), template),
        contents.array("across_covariances", (f, 3 * m, 3 * m)),
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
        volume_deviations=contents.array("volume_deviations", (f,)) if has_volumes else None,
        unseen=tuple(contents.array("unseen", (None,)).tolist()),
        volume_correlation=estimate["volume_correlation"],
        reference=estimate["reference"],
        data=_data_in(contents, sizes),
        notes=notes.notes_from_json(contents.json("notes", list)),
        provenance=contents.json("provenance", dict),
        images=None if estimate["images"] is None else result.ImageAnswer(**estimate["images"]),
    )
    return track.informed()
