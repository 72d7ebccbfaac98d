"""GLB animations: morph targets whose weights move, on nodes that may move as well.

Positions are evaluated at the keyframes of all channels that move a mesh.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError
from modalmotion.formats.gltf.animation import Channel, Key, read_channels, to_matrices
from modalmotion.formats.gltf.container import (
    Container,
    malformed,
    read_accessor,
    read_container,
    too_much,
)
from modalmotion.formats.result import Reading, Source
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh import NO_FACTS, Facts
from modalmotion.mesh.checks import given_up
from modalmotion.mesh.sequence import mesh_sequence

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


_DEEPEST: Final = 100
# Moving nodes times frames; beyond it, matrices alone would take seconds.
_MOST_MOVING_NODES: Final = 500_000

Chain = tuple[int, ...]


@dataclass(frozen=True)
class MeshNode:
    """A node that shows a mesh.

    Parameters
    ----------
    chain : tuple of int
        From the root of the scene to the node itself.
    mesh : int
    """

    chain: Chain
    mesh: int


def mesh_nodes(container: Container) -> list[MeshNode]:
    """Find the nodes with meshes, in the order of the scene.

    Raises
    ------
    MalformedFileError
        If nodes do not form a tree, or a skeleton moves a mesh.
    LimitError
        If it has too many nodes, or they stand too deep below each other.
    """
    nodes = []
    seen: set[int] = set()
    waiting: list[tuple[Chain, Any]] = [((), root) for root in reversed(_roots(container))]
    while waiting:
        above, index = waiting.pop()
        node = container.item("nodes", index)
        if index in seen:
            raise malformed(
                f"Node {index} of the GLB file stands below two others, or below itself."
            )
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
            nodes.append(MeshNode(chain, node["mesh"]))
        waiting += [(chain, child) for child in reversed(node.get("children", []))]
    return nodes


def transforms_at(
    container: Container,
    nodes: list[MeshNode],
    channels: dict[Key, Channel],
    times: NDArray[np.float64],
) -> dict[Chain, NDArray[np.float64]]:
    """Place nodes in the world over time.

    Parameters
    ----------
    container : Container
    nodes : list of MeshNode
    channels : dict of (node, path) to Channel
    times : (frames,) float64, s

    Returns
    -------
    dict of chain to (frames or 1, 4, 4) float64
        Of each node and of all above it, each computed once.
    """
    concerned = {index for node in nodes for index in node.chain}
    n_moving = len({node for node, path in channels if path != "weights"} & concerned)
    if n_moving * len(times) > _MOST_MOVING_NODES:
        raise too_much(f"moves {n_moving} nodes over {len(times)} frames", _MOST_MOVING_NODES)
    worlds: dict[Chain, NDArray[np.float64]] = {(): np.eye(4)[None]}
    for node in nodes:
        for depth, index in enumerate(node.chain):
            above, here = node.chain[:depth], node.chain[: depth + 1]
            if here not in worlds:
                local = _local(container.item("nodes", index), index, channels, times)
                worlds[here] = worlds[above] @ local
    return worlds


def _local(
    node: dict[str, Any],
    index: int,
    channels: dict[Key, Channel],
    times: NDArray[np.float64],
) -> NDArray[np.float64]:
    if "matrix" in node:
        # Column by column.
        return _numbers(node, "matrix", 16).reshape(1, 4, 4).transpose(0, 2, 1)
    parts = {
        path: channels[index, path].at(times)
        if (index, path) in channels
        else _numbers(node, path, len(rest), rest)[None]
        for path, rest in (
            ("translation", [0.0, 0.0, 0.0]),
            ("rotation", [0.0, 0.0, 0.0, 1.0]),
            ("scale", [1.0, 1.0, 1.0]),
        )
    }
    n_frames = max(len(values) for values in parts.values())
    if not parts["rotation"].any(axis=1).all():
        raise malformed("A rotation in the GLB file is a quaternion of zero length.")
    local = np.zeros((n_frames, 4, 4))
    # M = T R S
    local[:, :3, :3] = to_matrices(parts["rotation"]) * parts["scale"][:, None, :]
    local[:, :3, 3] = parts["translation"]
    local[:, 3, 3] = 1.0
    return local


def _numbers(
    node: dict[str, Any], name: str, n: int, default: list[float] | None = None
) -> NDArray[np.float64]:
    values = np.array(node.get(name, default), dtype=np.float64)
    if values.shape != (n,) or not np.isfinite(values).all():
        raise malformed(f"A node of the GLB file has the {name} {str(node.get(name))[:60]}.")
    return values


def _roots(container: Container) -> list[Any]:
    if "scenes" not in container.document:
        below = {
            child for node in container.document["nodes"] for child in node.get("children", [])
        }
        return [i for i in range(len(container.document["nodes"])) if i not in below]
    scene = container.item("scenes", container.document.get("scene", 0))
    return list(scene.get("nodes", []))


OURS: Final = "modalmotion"
"""Name under which our own files hold unit and times in the extras of the asset."""

_COORDINATES: Final = "Y up"

# Bytes in memory for each byte of the file: a few shapes may move over a thousand frames.
_UNFOLDING: Final = 200

# Extensions that do not move vertices, or that are read.
_HARMLESS: Final = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_mesh_quantization")

# Errors of reading a document of the wrong shape, at any place.
_MISSHAPEN: Final = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError)


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
    _require_known_extensions(container.document.get("extensionsRequired", []))
    channels, others = read_channels(container, animation, limits)
    nodes = mesh_nodes(container)
    if not nodes:
        raise malformed("The GLB file's scene shows no mesh.")
    times = _key_times(nodes, channels)
    limits.require("frames", len(times))
    worlds = transforms_at(container, nodes, channels, times)
    meshes: dict[int, MorphMesh] = {}
    pieces: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    ignored: dict[str, None] = {}
    n_vertices, n_targets = 0, 0
    for node in nodes:
        if node.mesh not in meshes:
            meshes[node.mesh] = read_morph_mesh(container, node.mesh, limits)
        mesh = meshes[node.mesh]
        ignored |= dict.fromkeys(mesh.ignored)
        faces.append(mesh.faces + n_vertices)
        n_vertices += len(mesh.base)
        n_targets += len(mesh.targets)
        limits.require("vertices", n_vertices)
        limits.require("faces", sum(map(len, faces)))
        limits.require("decompressed_bytes", len(times) * n_vertices * 24)
        pieces.append(_positions(container, node, mesh, channels, times, worlds))
    ours = _ours(container)
    is_timed = bool(channels) and "times_unknown" not in ours
    start = ours.get("start_time", 0.0)
    sequence = mesh_sequence(
        given_up(np.concatenate(pieces, axis=1)),
        np.concatenate(faces),
        grid=ours.get("grid"),
        topology=_text(ours, "topology"),
        times=times + float(start) if is_timed else None,
        unit=None if "unit_unknown" in ours else _text(ours, "unit") or "m",
        # glTF 2.0, 3.4: "a right-handed coordinate system". Our own files are written unturned.
        facts=NO_FACTS if ours else Facts(handedness="right"),
    )
    ignored |= dict.fromkeys(f"animation {name}" for name in others)
    unit_from: Source = "file" if "unit" in ours else "format"
    return Reading(
        sequence,
        ignored=tuple(ignored),
        format="glb",
        coordinate_system=None if ours else _COORDINATES,
        unit_from=None if sequence.unit is None else unit_from,
        times_from="file" if is_timed else None,
        notes=tuple(_notes(sequence.vertices[0], n_targets, channels)),
    )


def _key_times(nodes: list[MeshNode], channels: dict[Key, Channel]) -> NDArray[np.float64]:
    concerned = {index for node in nodes for index in node.chain}
    keys = [channel.times for (node, _), channel in channels.items() if node in concerned]
    return np.unique(np.concatenate(keys)) if keys else np.zeros(1)


def _positions(
    container: Container,
    node: MeshNode,
    mesh: MorphMesh,
    channels: dict[Key, Channel],
    times: NDArray[np.float64],
    worlds: dict[Chain, NDArray[np.float64]],
) -> NDArray[np.float64]:
    n_targets, n_vertices, _ = mesh.targets.shape
    channel = channels.get((node.chain[-1], "weights"))
    stated = container.item("nodes", node.chain[-1]).get("weights", mesh.weights)
    weights = np.array(stated, dtype=np.float64)[None] if channel is None else channel.at(times)
    if weights.shape[1:] != (n_targets,) or not np.isfinite(weights).all():
        raise malformed(
            f"The GLB file has {weights.shape[-1]} weights for {n_targets} morph targets."
        )
    # x(t) = M(t) (base + sum_i w_i(t) target_i)
    moved = np.tensordot(weights, mesh.targets, axes=(1, 0)) + mesh.base
    M = worlds[node.chain]
    placed = np.matmul(moved, M[:, :3, :3].transpose(0, 2, 1)) + M[:, None, :3, 3]
    return np.broadcast_to(placed, (len(times), n_vertices, 3))


def _ours(container: Container) -> dict[str, Any]:
    extras = container.document.get("asset", {}).get("extras", {})
    ours = extras.get(OURS, {}) if isinstance(extras, dict) else {}
    return ours if isinstance(ours, dict) else {}


def _text(ours: dict[str, Any], name: str) -> str | None:
    value = ours.get(name)
    if value is not None and not isinstance(value, str):
        raise malformed(f"The GLB file states {name} as {str(value)[:20]!r}.")
    return value


def _require_known_extensions(required: list[Any]) -> None:
    for name in required:
        if not str(name).startswith(_HARMLESS):
            raise MalformedFileError(
                f"The GLB file cannot be read without {str(name)[:60]!r}, which is unknown here.",
                remedy="Export again without extensions (no compression, no instancing).",
            )


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
