"""Templates as HDF5."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from modalmotion.hdf5.form import Form
from modalmotion.hdf5.image import Contents, Dataset, json_text
from modalmotion.modes.topology import MESH, Topology
from modalmotion.template.landmarks import Landmarks
from modalmotion.template.template import Template, is_merged

FORM: Final = Form("template", 1)


def template_to_hdf5(template: Template) -> bytes:
    """Write a template as a sealed HDF5 file in memory.

    Parameters
    ----------
    template : Template

    Returns
    -------
    bytes
        The same for the same template.
    """
    length = "length unit of the sequence"
    datasets = [
        Dataset("coordinates", template.coordinates, "1", "vertex, axis"),
        Dataset("weights", template.weights, "1", "vertex"),
        Dataset("lengths", np.array(template.lengths, dtype=np.float64), length, "axis"),
        Dataset("vertices", template.vertices, length, "vertex, direction"),
        Dataset("faces", template.faces.astype("<i8", copy=False), "1", "face, corner"),
        Dataset("isolated", template.isolated.astype("<i8", copy=False), "1", "vertex"),
        json_text("texts", {"reason": template.reason, "notes": template.notes}),
    ]
    if is_merged(template.representatives):
        first = template.representatives.astype("<i8", copy=False)
        datasets.append(Dataset("representatives", first, "1", "vertex"))
    if template.landmarks is not None:
        datasets += landmark_datasets(template.landmarks, length)
    topology = MESH if template.surface is None else template.surface.name
    return FORM.image({"template_id": template.id}, datasets, topology=topology)


def template_from_hdf5(source: bytes | Path) -> Template:
    """Read a template, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    return read_template(source)[0]


def read_template(source: bytes | Path) -> tuple[Template, Contents]:
    """Read a template together with the contents of its file."""
    with FORM.read(source) as contents:
        return _template(contents), contents


def _template(contents: Contents) -> Template:
    name = contents.text("topology")
    weights = contents.array("weights", (None,))
    texts = contents.json("texts", dict)
    return Template(
        id=contents.text("template_id"),
        surface=None if name == MESH else Topology.parse(name),
        coordinates=contents.array("coordinates", (len(weights), None)),
        weights=weights,
        lengths=tuple(contents.array("lengths", (None,)).tolist()),
        landmarks=landmarks_from(contents),
        vertices=contents.array("vertices", (len(weights), 3)),
        faces=contents.array("faces", (None, 3)),
        representatives=contents.array("representatives", (len(weights),))
        if "representatives" in contents.arrays
        else np.arange(len(weights)),
        isolated=contents.array("isolated", (None,)),
        reason=texts["reason"],
        notes=tuple(texts["notes"]),
    )


_VECTORS: Final = ("origin", "axis", "theta_zero", "apex", "base")


def landmark_datasets(landmarks: Landmarks, unit: str) -> list[Dataset]:
    """Datasets that contain landmarks."""
    vectors = np.array([getattr(landmarks, name) for name in _VECTORS], dtype=np.float64)
    rest = {
        "strengths": dict(landmarks.strengths),
        "n_loops": landmarks.n_loops,
        "given": landmarks.given,
    }
    axes = "origin axis theta_zero apex base, direction"
    return [Dataset("landmarks", vectors, unit, axes), json_text("landmark_strengths", rest)]


def landmarks_from(contents: Contents) -> Landmarks | None:
    """Landmarks that a file holds, None if there are none."""
    if "landmarks" not in contents.arrays:
        return None
    vectors = contents.array("landmarks", (len(_VECTORS), 3))
    rest = contents.json("landmark_strengths", dict)
    return Landmarks(
        **dict(zip(_VECTORS, vectors, strict=True)),
        strengths=rest["strengths"],
        n_loops=rest["n_loops"],
        given=tuple(rest["given"]),
    )
