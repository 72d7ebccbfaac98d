"""GLB animations: morph targets whose weights move, on nodes that may move as well.

Positions are evaluated at the keyframes of all channels that move a mesh.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError
from modalmotion.formats.gltf.animation import Channel, Key, read_channels
from modalmotion.formats.gltf.container import (
    Container,
    malformed,
    read_accessor,
    read_container,
    too_much,
)
from modalmotion.formats.result import Reading, reading_of
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh import NO_FACTS, Facts

OURS: Final = "modalmotion"
"""Name under which our own files hold unit and times in the extras of the asset."""

_TRIANGLES: Final = 4
_STRIPS_AND_FANS: Final = (5, 6)
_COMPRESSED: Final = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
# Extensions that do not move vertices, or that are read.
_HARMLESS: Final = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_mesh_quantization")

_DEEPEST: Final = 100
# Moving nodes times frames; beyond it, matrices alone would take seconds.
_MOST_MOVING_NODES: Final = 500_000
# Bytes in memory for each byte of the file: a few shapes may move over a thousand frames.
_UNFOLDING: Final = 200

# Errors of reading a document of the wrong shape, at any place.
_MISSHAPEN: Final = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError)

# Nodes from the root of the scene to one that shows a mesh.
Chain = tuple[int, ...]


def read_glb(
    data: bytes, limits: ReadLimits = DEFAULT_LIMITS, *, animation: str | None = None
) -> Reading:
    """Read a sequence from a binary glTF file.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional
    animation : str, optional
        Name of the animation; the first by default.

    Returns
    -------
    Reading
        All meshes of the scene as one, in its order. The unit is the metre by the format's
        definition, unless the file is our own and states another.

    Raises
    ------
    MalformedFileError
        If it cannot be read, names data elsewhere, is compressed, or is moved by a skeleton.
    LimitError
        If it declares more than `limits` accept.
    ParameterError
        If no animation has that name.
    """
    container = read_container(data)
    limits = limits.of_file(len(data), _UNFOLDING)
    try:
        # Numbers of any size may be in a file; the validator finds overflows.
        with np.errstate(all="ignore"):
            return _read(container, animation, limits)
    except InputError:
        raise
    except _MISSHAPEN as error:
        raise malformed(
            f"The GLB file's document does not follow glTF ({type(error).__name__}: "
            f"{str(error)[:60]})."
        ) from error


def _read(container: Container, animation: str | None, limits: ReadLimits) -> Reading:
    for name in map(str, container.document.get("extensionsRequired", [])):
        if not name.startswith(_HARMLESS):
            raise MalformedFileError(
                f"The GLB file cannot be read without {name[:60]!r}, which is unknown here.",
                remedy="Export again without extensions (no compression, no instancing).",
            )
    channels, others = read_channels(container, animation, limits)
    chains = _mesh_chains(container)
    if not chains:
        raise malformed("The GLB file's scene shows no mesh.")
    concerned = {index for chain in chains for index in chain}
    keys = [channel.times for (node, _), channel in channels.items() if node in concerned]
    times = np.unique(np.concatenate(keys)) if keys else np.zeros(1)
    limits.require("frames", len(times))
    n_moving = len({node for node, path in channels if path != "weights"} & concerned)
    if n_moving * len(times) > _MOST_MOVING_NODES:
        raise too_much(f"moves {n_moving} nodes over {len(times)} frames", _MOST_MOVING_NODES)

    @cache
    def world(chain: Chain) -> NDArray[np.float64]:
        """Place of a node over time, (frames or 1, 4, 4)."""
        if not chain:
            return np.eye(4)[None]
        local = _local(container.item("nodes", chain[-1]), chain[-1], channels, times)
        return world(chain[:-1]) @ local

    @cache
    def mesh_of(index: int) -> _Mesh:
        return _mesh(container, index, limits, ignored)

    pieces: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    ignored: dict[str, None] = {}
    n_vertices, n_targets = 0, 0
    for chain in chains:
        node = container.item("nodes", chain[-1])
        mesh = mesh_of(node["mesh"])
        faces.append(mesh.faces + n_vertices)
        n_vertices += len(mesh.base)
        n_targets += len(mesh.targets)
        limits.require("vertices", n_vertices)
        limits.require("faces", sum(map(len, faces)))
        limits.require("decompressed_bytes", len(times) * n_vertices * 24)
        weights = np.array(node.get("weights", mesh.weights), dtype=np.float64)[None]
        if (channel := channels.get((chain[-1], "weights"))) is not None:
            weights = channel.at(times)
        moved = _placed(mesh, weights, world(chain))
        pieces.append(np.broadcast_to(moved, (len(times), *mesh.base.shape)))
    extras = container.document.get("asset", {}).get("extras", {})
    ours = extras.get(OURS, {}) if isinstance(extras, dict) else {}
    ours = ours if isinstance(ours, dict) else {}
    is_timed = bool(channels) and "times_unknown" not in ours
    vertices = np.concatenate(pieces, axis=1)
    return reading_of(
        vertices,
        np.concatenate(faces),
        format="glb",
        grid=ours.get("grid"),
        topology=str(ours["topology"]) if "topology" in ours else None,
        times=times + float(ours.get("start_time", 0.0)) if is_timed else None,
        unit=None if "unit_unknown" in ours else str(ours.get("unit") or "m"),
        # glTF 2.0, 3.4: "a right-handed coordinate system". Our own files are written unturned.
        facts=NO_FACTS if ours else Facts(handedness="right"),
        unit_from="file" if "unit" in ours else "format",
        notes=_notes(vertices[0], n_targets, channels),
        ignored=(*ignored, *(f"animation {name}" for name in others)),
        coordinate_system=None if ours else "Y up",
    )


def _mesh_chains(container: Container) -> list[Chain]:
    """Find the nodes with meshes, in the order of the scene."""
    document = container.document
    if "scenes" in document:
        roots = container.item("scenes", document.get("scene", 0)).get("nodes", [])
    else:
        below = {child for node in document["nodes"] for child in node.get("children", [])}
        roots = [i for i in range(len(document["nodes"])) if i not in below]
    chains = []
    seen: set[int] = set()
    waiting: list[tuple[Chain, Any]] = [((), root) for root in reversed(roots)]
    while waiting:
        above, index = waiting.pop()
        node = container.item("nodes", index)
        if index in seen:
            raise malformed(f"Node {index} of the GLB file has two parents, or is part of itself.")
        seen.add(index)
        container.count("nodes")
        if len(above) >= _DEEPEST:
            raise too_much(f"has nodes more than {_DEEPEST} deep", _DEEPEST)
        chain = (*above, index)
        if "mesh" in node:
            if "skin" in node:
                raise MalformedFileError(
                    "The GLB file moves its mesh by a skeleton (skin), which is not evaluated.",
                    remedy="Bake the animation to shape keys (morph targets) and export again, or "
                    "export each frame as PLY or OBJ and send them as .zip.",
                )
            container.count("mesh nodes")
            chains.append(chain)
        waiting += [(chain, child) for child in reversed(node.get("children", []))]
    return chains


def _local(
    node: dict[str, Any], index: int, channels: dict[Key, Channel], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    if "matrix" in node:
        # Column by column.
        return _numbers(node, "matrix", [0.0] * 16).reshape(1, 4, 4).transpose(0, 2, 1)
    parts = {
        path: channels[index, path].at(times)
        if (index, path) in channels
        else _numbers(node, path, rest)[None]
        for path, rest in (
            ("translation", [0.0, 0.0, 0.0]),
            ("rotation", [0.0, 0.0, 0.0, 1.0]),
            ("scale", [1.0, 1.0, 1.0]),
        )
    }
    local = np.zeros((max(map(len, parts.values())), 4, 4))
    # M = T R S
    turns = scipy.spatial.transform.Rotation.from_quat(parts["rotation"])
    local[:, :3, :3] = turns.as_matrix() * parts["scale"][:, None, :]
    local[:, :3, 3] = parts["translation"]
    local[:, 3, 3] = 1.0
    return local


def _numbers(node: dict[str, Any], name: str, default: list[float]) -> NDArray[np.float64]:
    values = np.array(node.get(name, default), dtype=np.float64)
    if values.shape != (len(default),) or not np.isfinite(values).all():
        raise malformed(f"A node of the GLB file has the {name} {str(node.get(name))[:60]}.")
    return values


class _Mesh(NamedTuple):
    """Vertices, targets that move them (targets, vertices, 3), triangles, and default weights."""

    base: NDArray[np.float64]
    targets: NDArray[np.float64]
    faces: NDArray[np.int64]
    weights: NDArray[np.float64]


def _mesh(container: Container, index: int, limits: ReadLimits, ignored: dict[str, None]) -> _Mesh:
    """Read all primitives of a mesh as one; those over the same accessors share vertices."""
    mesh = container.item("meshes", index)
    # First vertex and number of vertices of each set of accessors.
    blocks: dict[tuple[Any, ...], tuple[int, int]] = {}
    bases: list[NDArray[np.float64]] = []
    targets: list[NDArray[np.float64]] = []
    faces = []
    n_vertices = n_faces = 0
    for primitive in mesh["primitives"]:
        container.count("parts of meshes")
        is_plain = not _COMPRESSED & primitive.get("extensions", {}).keys()
        if not is_plain or primitive.get("mode", _TRIANGLES) in _STRIPS_AND_FANS:
            raise MalformedFileError(
                "The GLB file's mesh is compressed, or of triangle strips or fans.",
                remedy="Export again as triangles without compression.",
            )
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
            targets.append(np.zeros((len(listed), *base.shape)))
            for number, accessor in enumerate(listed):
                # One that moves normals only has none.
                if accessor is not None:
                    target = read_accessor(container, accessor, 3, limits, "vertices")
                    if len(target) != len(base):
                        raise malformed(
                            f"Morph target {number} of the GLB file has {len(target)} vertices, "
                            f"the mesh {len(base)}."
                        )
                    targets[-1][number] = target
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
    joined = np.concatenate(bases), np.concatenate(targets, axis=1), np.concatenate(faces)
    return _Mesh(*joined, weights)


def _faces(
    container: Container, primitive: dict[str, Any], n_vertices: int, limits: ReadLimits
) -> NDArray[np.int64]:
    if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
        return np.zeros((0, 3), dtype=np.int64)
    corners = np.arange(n_vertices)
    if "indices" in primitive:
        corners = read_accessor(container, primitive["indices"], 1, limits, "faces", 3)[:, 0]
    if len(corners) % 3 or corners.dtype.kind not in "iu":
        raise malformed(f"Triangles in the GLB file have {len(corners)} corners.")
    if len(corners) and int(corners.max()) >= n_vertices:
        raise malformed(f"A triangle of the GLB file names vertex {corners.max()} of {n_vertices}.")
    return corners.astype(np.int64).reshape(-1, 3)


def _placed(
    mesh: _Mesh, weights: NDArray[np.float64], M: NDArray[np.float64]
) -> NDArray[np.float64]:
    n_targets = len(mesh.targets)
    if weights.shape[1:] != (n_targets,) or not np.isfinite(weights).all():
        raise malformed(
            f"The GLB file has {weights.shape[-1]} weights for {n_targets} morph targets."
        )
    # x(t) = M(t) (base + sum_i w_i(t) target_i)
    moved = np.tensordot(weights, mesh.targets, axes=(1, 0)) + mesh.base
    placed: NDArray[np.float64] = np.matmul(moved, M[:, :3, :3].transpose(0, 2, 1))
    return placed + M[:, None, :3, 3]


def _notes(positions: NDArray[Any], n_targets: int, channels: dict[Key, Channel]) -> list[str]:
    notes = []
    if not channels:
        notes.append("The file contains no animation: there is one frame.")
    elif n_targets == 0:
        notes.append("The mesh has no morph targets: it moves as a rigid body.")
    n_twice = len(positions) - len(np.unique(positions, axis=0))
    if n_twice:
        notes.append(
            f"{n_twice} vertices coincide with another: exporters split vertices along seams of "
            "normals and textures. Export without both to keep the surface whole."
        )
    return notes
