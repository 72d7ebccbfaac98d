"""Nodes of a glTF scene: which of them have meshes, and where they are at any time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.gltf.channels import Channel, Key
from modalmotion.formats.gltf.container import Container, malformed, too_much
from modalmotion.formats.gltf.quaternions import to_matrices

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
