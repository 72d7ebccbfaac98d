"""GLB animations: morph targets whose weights move, on nodes that may move as well.

Positions are evaluated at the keyframes of all channels that move a mesh.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, MalformedFileError
from modalmotion.formats.gltf.channels import Channel, Key, read_channels
from modalmotion.formats.gltf.container import Container, malformed, read_container
from modalmotion.formats.gltf.meshes import MorphMesh, read_morph_mesh
from modalmotion.formats.gltf.scene import Chain, MeshNode, mesh_nodes, transforms_at
from modalmotion.formats.result import Reading, Source
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh import NO_FACTS, Facts
from modalmotion.mesh.checks import given_up
from modalmotion.mesh.sequence import mesh_sequence

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
