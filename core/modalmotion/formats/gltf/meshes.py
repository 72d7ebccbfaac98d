"""Meshes of a glTF file: base positions, morph targets and triangles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.gltf.accessors import read_accessor
from modalmotion.formats.gltf.container import Container, malformed
from modalmotion.limits import ReadLimits

_TRIANGLES: Final = 4
_STRIPS_AND_FANS: Final = (5, 6)
_COMPRESSED: Final = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")


@dataclass(frozen=True, eq=False)
class MorphMesh:
    """A mesh whose vertices are moved by weighted targets.

    Parameters
    ----------
    base : (vertices, 3) float64
    targets : (targets, vertices, 3) float64
    faces : (faces, 3) int64
    weights : (targets,) float64
        Default, unless an animation changes them.
    ignored : tuple of str
        Attributes that were not read.
    """

    base: NDArray[np.float64]
    targets: NDArray[np.float64]
    faces: NDArray[np.int64]
    weights: NDArray[np.float64]
    ignored: tuple[str, ...]


def read_morph_mesh(container: Container, index: int, limits: ReadLimits) -> MorphMesh:
    """Read all primitives of a mesh as one.

    Primitives over the same accessors share vertices, as they do in the file.

    Raises
    ------
    MalformedFileError
        If they are compressed, strips or fans, or do not fit each other.
    LimitError
        If it holds more than `limits` accept.
    """
    mesh = container.item("meshes", index)
    # First vertex and number of vertices of each set of accessors.
    blocks: dict[tuple[Any, ...], tuple[int, int]] = {}
    bases: list[NDArray[np.float64]] = []
    targets: list[NDArray[np.float64]] = []
    faces = []
    ignored: dict[str, None] = {}
    n_vertices = 0
    n_faces = 0
    for primitive in mesh["primitives"]:
        container.count("parts of meshes")
        _require_plain(primitive)
        attributes = primitive["attributes"]
        listed = [target.get("POSITION") for target in primitive.get("targets", [])]
        ignored |= dict.fromkeys(str(name) for name in attributes if name != "POSITION")
        key = (attributes["POSITION"], *listed)
        if key not in blocks:
            base = read_accessor(container, attributes["POSITION"], 3, limits, "vertices")
            blocks[key] = n_vertices, len(base)
            bases.append(base.astype(np.float64))
            n_vertices += len(base)
            limits.require("vertices", n_vertices)
            limits.require("decompressed_bytes", (len(listed) + 1) * n_vertices * 24)
            targets.append(_targets(container, listed, len(base), limits))
        start, size = blocks[key]
        faces.append(_faces(container, primitive, size, limits) + start)
        n_faces += len(faces[-1])
        limits.require("faces", n_faces)
    if len({len(block) for block in targets}) != 1:
        raise malformed("Parts of a mesh in the GLB file have different numbers of morph targets.")
    n_targets = len(targets[0])
    weights = np.array(mesh.get("weights", [0.0] * n_targets), dtype=np.float64)
    if weights.shape != (n_targets,) or not np.isfinite(weights).all():
        raise malformed("A mesh in the GLB file has other weights.")
    return MorphMesh(
        np.concatenate(bases),
        np.concatenate(targets, axis=1),
        np.concatenate(faces),
        weights,
        tuple(ignored),
    )


def _targets(
    container: Container, listed: list[Any], n_vertices: int, limits: ReadLimits
) -> NDArray[np.float64]:
    targets = np.zeros((len(listed), n_vertices, 3))
    for number, accessor in enumerate(listed):
        if accessor is None:
            # A target that moves normals only.
            continue
        target = read_accessor(container, accessor, 3, limits, "vertices")
        if len(target) != n_vertices:
            raise malformed(
                f"Morph target {number} of the GLB file has {len(target)} vertices, the mesh "
                f"{n_vertices}."
            )
        targets[number] = target
    return targets


def _faces(
    container: Container, primitive: dict[str, Any], n_vertices: int, limits: ReadLimits
) -> NDArray[np.int64]:
    if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
        return np.zeros((0, 3), dtype=np.int64)
    if "indices" in primitive:
        corners = read_accessor(container, primitive["indices"], 1, limits, "faces", 3)[:, 0]
    else:
        corners = np.arange(n_vertices)
    if len(corners) % 3 or corners.dtype.kind not in "iu":
        raise malformed(f"Triangles in the GLB file have {len(corners)} corners.")
    if len(corners) and int(corners.max()) >= n_vertices:
        raise malformed(f"A triangle of the GLB file names vertex {corners.max()} of {n_vertices}.")
    return corners.astype(np.int64).reshape(-1, 3)


def _require_plain(primitive: dict[str, Any]) -> None:
    compressions = [name for name in _COMPRESSED if name in primitive.get("extensions", {})]
    if compressions:
        raise MalformedFileError(
            f"The GLB file's mesh is compressed by {compressions[0]}, which cannot be read.",
            remedy="Export again without compression.",
        )
    if primitive.get("mode", _TRIANGLES) in _STRIPS_AND_FANS:
        raise MalformedFileError(
            "The GLB file contains triangle strips or fans.", remedy="Export again as triangles."
        )
