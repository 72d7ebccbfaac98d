"""Writing GLB: a mesh with morph targets, its weights, rotation and translation animated."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.formats.gltf.animation import MorphAnimation, to_quaternions
from modalmotion.formats.gltf.container import write_container
from modalmotion.formats.gltf.reading import OURS
from modalmotion.mesh.checks import single_precision

FRAMES_PER_SECOND: Final = 25.0
"""Rate at which frames without times play; the format needs seconds."""

_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_POINTS, _TRIANGLES = 0, 4


def write_glb(animation: MorphAnimation) -> bytes:
    """Write a binary glTF file that plays in three.js, Blender and VTK.

    Positions are written as float32, without scaling to metres or turning of axes.
    Weights are written from 0 to 1, for Blender holds them there: a target is then the way
    from its least weight to its greatest, and the base has all of them at their least. Both
    ends are in the extras of the asset, with unit, first time and omissions.

    Parameters
    ----------
    animation : MorphAnimation

    Returns
    -------
    bytes
        The same for the same animation.

    Raises
    ------
    ParameterError
        If two times are the same as float32 after the first is subtracted.
    """
    n_frames = animation.n_frames
    times = animation.times
    if times is None:
        times = np.arange(n_frames) / FRAMES_PER_SECOND
    keys = (times - times[0]).astype(np.float32)
    if (np.diff(keys) <= 0).any():
        frame = int(np.flatnonzero(np.diff(keys) <= 0)[0]) + 1
        raise ParameterError(
            f"Frames {frame - 1} and {frame} are too close in time for glTF (float32).",
            remedy="Leave frames out, or write VTKHDF.",
            frame=frame,
        )
    least = animation.weights.min(axis=0)
    spans = animation.weights.max(axis=0) - least
    away = animation.weights - least
    weights = np.divide(away, spans, out=np.zeros_like(away), where=spans > 0)
    n_targets = len(animation.targets)
    base = animation.base + np.tensordot(least, animation.targets, axes=(0, 0))
    buffer = _Buffer()
    primitive: dict[str, Any] = {
        "attributes": {"POSITION": buffer.add(base, "VEC3", _VERTICES, bounds=True)},
        "mode": _TRIANGLES if len(animation.faces) else _POINTS,
    }
    if len(animation.faces):
        corners = animation.faces.reshape(-1).astype("<u4")
        primitive["indices"] = buffer.add(corners, "SCALAR", _INDICES)
    mesh: dict[str, Any] = {"primitives": [primitive]}
    if n_targets:
        primitive["targets"] = [
            {"POSITION": buffer.add(span * target, "VEC3", _VERTICES, bounds=True)}
            for span, target in zip(spans, animation.targets, strict=True)
        ]
        mesh["weights"] = weights[0].tolist()
        # Where Blender and three.js look for them.
        mesh["extras"] = {"targetNames": list(animation.target_names)}
    moved = [
        ("rotation", to_quaternions(animation.rotations), "VEC4"),
        ("translation", animation.translations, "VEC3"),
    ]
    if n_targets:
        moved.append(("weights", weights.reshape(-1), "SCALAR"))
    clock = buffer.add(keys, "SCALAR", bounds=True)
    samplers = [
        {"input": clock, "interpolation": "LINEAR", "output": buffer.add(values, kind)}
        for _, values, kind in moved
    ]
    channels = [
        {"sampler": number, "target": {"node": 0, "path": path}}
        for number, (path, _, _) in enumerate(moved)
    ]
    document = {
        "asset": {
            "version": "2.0",
            "generator": "modalmotion",
            "extras": {OURS: _extras(animation, least, spans)},
        },
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "surface", "mesh": 0}],
        "meshes": [mesh],
        "animations": [{"name": "motion", "samplers": samplers, "channels": channels}],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": buffer.length}],
    }
    return write_container(document, buffer.content())


class _Buffer:
    """The one block of bytes, grown array by array."""

    def __init__(self) -> None:
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self.length = 0
        self._pieces: list[bytes] = []

    def add(
        self, values: NDArray[Any], kind: str, target: int | None = None, *, bounds: bool = False
    ) -> int:
        """Append an array and return its accessor."""
        is_index = values.dtype.kind == "u"
        plain: NDArray[Any] = values if is_index else single_precision(values, "A number")
        array = np.ascontiguousarray(plain, dtype="<u4" if is_index else "<f4")
        rows = array.reshape(len(array), -1)
        view = {"buffer": 0, "byteOffset": self.length, "byteLength": array.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        # Bounds are of the numbers as written, float32.
        ends = {"min": rows.min(axis=0), "max": rows.max(axis=0)} if bounds else {}
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": _UINT if is_index else _FLOAT,
                "count": len(rows),
                "type": kind,
                **{name: values.tolist() for name, values in ends.items()},
            }
        )
        # All types are of four bytes, so every array begins at a whole number of them.
        self._pieces.append(array.tobytes())
        self.length += array.nbytes
        return len(self.accessors) - 1

    def content(self) -> bytes:
        """Return all arrays, one after the other."""
        return b"".join(self._pieces)


def _extras(
    animation: MorphAnimation, least: NDArray[np.float64], spans: NDArray[np.float64]
) -> dict[str, Any]:
    times, topology = animation.times, animation.topology
    start = None if times is None or not times[0] else float(times[0])
    stated = {
        "unit": animation.unit,
        "unit_unknown": True if animation.unit is None else None,
        "times_unknown": True if times is None else None,
        "start_time": start,
        "topology": None if topology is None else topology.name,
        "grid": None if animation.grid is None else list(animation.grid),
    }
    return {
        "weight_ranges": np.stack([least, least + spans], axis=1).tolist(),
        "targets_left_out": animation.n_left_out,
        "rms_left_out": animation.rms_left_out,
        **{name: value for name, value in stated.items() if value is not None},
    }
