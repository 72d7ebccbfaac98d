"""Tracks as HDF5."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Final

import numpy as np

from modalmotion.errors import StoreError
from modalmotion.hdf5.form import form_of
from modalmotion.hdf5.image import UNKNOWN, Contents, Dataset, json_text
from modalmotion.mesh import facts_as_json, facts_from_json
from modalmotion.mesh.hdf5 import TRACK
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.modes import ModeSet
from modalmotion.modes.topology import Topology
from modalmotion.template.body_frame import affine_shapes
from modalmotion.template.hdf5 import landmark_datasets, landmarks_from
from modalmotion.template.template import Template
from modalmotion.template.vibration_modes import shapes_of
from modalmotion.tracking.deviations import uncertainty_of
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.prior import Prior
from modalmotion.tracking.result import ImageAnswer, SampledData, Track

FORM: Final = TRACK

# One number for each frame.
_OF_FRAMES: Final = ("truncations", "inliers", "coverage")


def track_to_hdf5(track: Track) -> bytes:
    """Write a track as a sealed HDF5 file in memory, its sequence and its template included.

    Parameters
    ----------
    track : Track

    Returns
    -------
    bytes
        The same for the same track.
    """
    sequence, template = track.sequence, track.template
    unit = sequence.unit or UNKNOWN
    square, axes = f"{unit}^2", "frame, mode direction, mode direction"
    known = sequence.uncertainty
    datasets = [
        Dataset("vertices", sequence.vertices, unit, "frame, vertex, direction"),
        Dataset("faces", template.faces.astype("<i8", copy=False), "1", "face, corner"),
        Dataset("amplitudes", track.amplitudes, unit, "frame, mode, direction"),
        Dataset("covariances", track.covariances, square, axes),
        Dataset(
            "across_covariances", track.covariances if known is None else known.across, square, axes
        ),
        Dataset("amplitude_deviations", track.amplitude_deviations, unit, "frame, mode, direction"),
        Dataset("wavenumbers", track.modes.wavenumbers, "1", "mode, axis"),
        Dataset("is_sine", track.modes.is_sine.astype(np.uint8), "1", "mode"),
        Dataset("determined", track.determined, "1", "mode, normal and tangential"),
        Dataset("deviations", track.deviations, unit, "frame, vertex, normal and tangential"),
        Dataset("truncations", track.truncations, unit, "frame"),
        Dataset("residuals", track.residuals, unit, "frame, rms and p95"),
        Dataset("inliers", track.inliers, "1", "frame"),
        Dataset("coverage", track.coverage, "1", "frame"),
        Dataset("unseen", np.array(track.unseen, dtype="<i8"), "1", "frame"),
        Dataset("reference_vertices", template.vertices, unit, "vertex, direction"),
        Dataset("coordinates", template.coordinates, "1", "vertex, axis"),
        Dataset("weights", template.weights, "1", "vertex"),
        Dataset("lengths", np.array(template.lengths, dtype=np.float64), unit, "axis"),
        Dataset("isolated", template.isolated.astype("<i8", copy=False), "1", "vertex"),
        Dataset(
            "representatives", template.representatives.astype("<i8", copy=False), "1", "vertex"
        ),
        json_text("estimate", _estimate(track)),
        json_text("facts", facts_as_json(sequence.facts)),
        json_text("notes", track.notes),
        json_text("template_notes", template.notes),
        json_text("provenance", dict(track.provenance)),
    ]
    datasets += _data(track, unit)
    if template.landmarks is not None:
        datasets += landmark_datasets(template.landmarks, unit)
    if sequence.times is not None:
        datasets.append(Dataset("times", sequence.times, "s", "frame"))
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


def track_from_hdf5(source: bytes | Path) -> Track:
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


def read_track(source: bytes | Path) -> tuple[Track, Contents]:
    """Read a track, and the contents of its file besides.

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    with FORM.read(source) as contents:
        return track_in(contents), contents


def kept_track(source: Path) -> Track | None:
    """Read the track that a file holds; None of other files."""
    if source.suffix.lower() not in (".h5", ".hdf5") or not source.is_file():
        return None
    try:
        is_track = form_of(source).kind == FORM.kind
    except StoreError:
        return None
    return track_from_hdf5(source) if is_track else None


def _data(track: Track, unit: str) -> list[Dataset]:
    data = track.data
    if data is None:
        return []
    return [
        Dataset("data_points", data.points, unit, "point, direction"),
        Dataset("data_weights", data.weights, "1", "point"),
        Dataset("data_are_landmarks", data.are_landmarks.astype("u1"), "1", "point"),
        Dataset("data_counts", data.counts.astype("<i8", copy=False), "1", "frame"),
    ]


def _data_in(contents: Contents, n_frames: int) -> SampledData | None:
    if "data_points" not in contents.arrays:
        return None
    points = contents.array("data_points", (None, 3))
    n = len(points)
    counts = contents.array("data_counts", (n_frames,))
    if counts.min(initial=0) < 0 or counts.sum() != n:
        raise ValueError(f"the frames have {counts.sum()} points, and there are {n}")
    return SampledData(
        points,
        contents.array("data_weights", (n,)),
        contents.array("data_are_landmarks", (n,)).astype(np.bool_),
        counts,
    )


def _estimate(track: Track) -> dict[str, object]:
    return {
        "prior": asdict(track.prior),
        "noise": asdict(track.noise),
        "harmonic": track.harmonic,
        "gap": track.gap,
        "reference": track.reference,
        "images": None if track.images is None else asdict(track.images),
        "ejection_fraction_percent": track.ejection_fraction,
        "ejection_fraction_bound": track.ejection_fraction_bound,
    }


def track_in(contents: Contents) -> Track:
    """Read the track that the contents of a file hold."""
    topology = Topology.parse(contents.text("topology"))
    amplitudes = contents.array("amplitudes", (None, None, 3))
    f, m, _ = amplitudes.shape
    weights = contents.array("weights", (None,))
    v = len(weights)
    faces = contents.array("faces", (None, 3))
    template = Template(
        id=contents.text("template_id"),
        surface=topology,
        coordinates=contents.array("coordinates", (v, topology.n_axes)),
        weights=weights,
        lengths=tuple(contents.array("lengths", (None,)).tolist()),
        landmarks=landmarks_from(contents),
        vertices=contents.array("reference_vertices", (v, 3)),
        faces=faces,
        representatives=contents.array("representatives", (v,)),
        isolated=contents.array("isolated", (None,)),
        reason="",
        notes=tuple(contents.json("template_notes", list)),
    )
    sequence = mesh_sequence(
        contents.array("vertices", (f, v, 3)),
        faces,
        grid=contents.attributes.get("grid"),
        topology=topology,
        times=contents.arrays.get("times"),
        unit=contents.unit,
    )
    estimate = contents.json("estimate", dict)
    has_volumes = "volume_deviations" in contents.arrays
    modes = ModeSet(
        topology,
        contents.array("wavenumbers", (m, topology.n_axes)),
        contents.array("is_sine", (m,)).astype(np.bool_),
    )
    covariances = contents.array("covariances", (f, 3 * m, 3 * m))
    uncertainty = uncertainty_of(
        template,
        affine_shapes(shapes_of(modes, template), template),
        contents.array("across_covariances", (f, 3 * m, 3 * m)),
        covariances,
        contents.array("truncations", (f,)),
        estimate["noise"]["n_values"],
        estimate["reference"],
    )
    sequence = replace(sequence, uncertainty=uncertainty)
    track = Track(
        sequence=sequence.with_facts(facts_from_json(contents.json("facts", dict))),
        template=template,
        modes=modes,
        amplitudes=amplitudes,
        covariances=covariances,
        prior=Prior(**estimate["prior"]),
        noise=Noise(**estimate["noise"]),
        deviations=contents.array("deviations", (f, v, 2)),
        volume_deviations=contents.array("volume_deviations", (f,)) if has_volumes else None,
        harmonic=estimate["harmonic"],
        residuals=contents.array("residuals", (f, 2)),
        **{name: contents.array(name, (f,)) for name in _OF_FRAMES},
        unseen=tuple(contents.array("unseen", (None,)).tolist()),
        gap=estimate["gap"],
        reference=estimate["reference"],
        data=_data_in(contents, f),
        notes=tuple(contents.json("notes", list)),
        provenance=contents.json("provenance", dict),
        images=None if estimate["images"] is None else ImageAnswer(**estimate["images"]),
    )
    return track.informed()
