"""GLB out: a mesh with morph targets, its weights, rotation and translation animated (glTF 2.0)."""

import json
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import scipy

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.mesh.checks import single_precision
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import Topology
from modalmotion.representation import Array, Floats, Ints, Singles, shown

OURS: Final = "modalmotion"
"""Name under which our own files hold unit and times in the extras of the asset."""

MAGIC: Final = b"glTF"
VERSION: Final = 2
JSON: Final = b"JSON"
BINARY: Final = b"BIN\x00"

# Rate at which frames without times play; the format needs seconds.
_FRAMES_PER_SECOND: Final = 25.0
_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_POINTS, _TRIANGLES = 0, 4


@shown("targets", "weights", "unit", "rms_left_out", "faces")
@dataclass(frozen=True, eq=False)
class MorphAnimation:
    """Positions over time as x(t) = R(t) (base + sum_i w_i(t) target_i) + T(t).

    Parameters
    ----------
    base : (vertices, 3) float64, in `unit`
    targets : (targets, vertices, 3) float32 or float64, in `unit` for a weight of one
    target_names : tuple of str
    weights : (frames, targets) float64
    rotations : (frames, 3, 3) float64
    translations : (frames, 3) float64, in `unit`
    faces : (faces, 3) int64
    times : (frames,) float64, s, optional
    unit : str, optional
    topology : Topology, optional
    grid : tuple of int, optional
    n_left_out : int
        Requested targets that were left out.
    rms_left_out : float, in `unit`
        RMS over vertices and frames of the displacement that they describe.

    Raises
    ------
    ShapeError
        If the arrays do not fit each other.
    """

    base: Floats
    targets: Floats | Singles
    target_names: tuple[str, ...]
    weights: Floats
    rotations: Floats
    translations: Floats
    faces: Ints
    times: Floats | None = None
    unit: str | None = None
    topology: Topology | None = None
    grid: tuple[int, ...] | None = None
    n_left_out: int = 0
    rms_left_out: float = 0.0

    def __post_init__(self) -> None:
        n_frames, n_targets = self.weights.shape
        for name, array, shape in (
            ("base", self.base, (len(self.base), 3)),
            ("targets", self.targets, (n_targets, len(self.base), 3)),
            ("rotations", self.rotations, (n_frames, 3, 3)),
            ("translations", self.translations, (n_frames, 3)),
            ("times", self.times, (n_frames,)),
        ):
            if array is not None and array.shape != shape:
                raise ShapeError(
                    f"{name!r} has the shape {array.shape}, not {shape}: there are {n_frames} "
                    f"frames of {n_targets} weights.",
                    remedy="Give every frame its weights, rotation, translation and time.",
                )

    def positions(self) -> Floats:
        """Positions of all frames, (frames, vertices, 3) float64, in `unit`."""
        u = np.tensordot(self.weights, self.targets, axes=(1, 0))
        # x(t) = R(t) (base + u(t)) + T(t)
        x: Floats = np.matmul(self.base + u, self.rotations.transpose(0, 2, 1))
        return x + self.translations[:, None, :]


def frame_animation(sequence: MeshSequence) -> MorphAnimation:
    """Make every frame but the first one a target, which its own frame has the weight 1 of.

    Parameters
    ----------
    sequence : MeshSequence

    Returns
    -------
    MorphAnimation
        At the keyframes the positions of the sequence.
    """
    n = sequence.n_frames
    x = sequence.vertices.astype(np.float64)
    return MorphAnimation(
        base=x[0],
        targets=x[1:] - x[0],
        target_names=tuple(f"frame {k}" for k in range(1, n)),
        weights=np.eye(n)[:, 1:],
        rotations=np.broadcast_to(np.eye(3), (n, 3, 3)),
        translations=np.zeros((n, 3)),
        faces=sequence.faces,
        times=sequence.times,
        unit=sequence.unit,
        topology=sequence.topology,
        grid=sequence.grid,
    )


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
    times = animation.times
    if times is None:
        times = np.arange(len(animation.weights)) / _FRAMES_PER_SECOND
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
    moved = {
        "rotation": (to_quaternions(animation.rotations), "VEC4"),
        "translation": (animation.translations, "VEC3"),
    }
    if len(spans):
        primitive["targets"] = [
            {"POSITION": buffer.add(span * target, "VEC3", _VERTICES, bounds=True)}
            for span, target in zip(spans, animation.targets, strict=True)
        ]
        mesh["weights"] = weights[0].tolist()
        # Where Blender and three.js look for them.
        mesh["extras"] = {"targetNames": list(animation.target_names)}
        moved["weights"] = weights.reshape(-1), "SCALAR"
    clock = buffer.add(keys, "SCALAR", bounds=True)
    samplers = [
        {"input": clock, "interpolation": "LINEAR", "output": buffer.add(values, kind)}
        for values, kind in moved.values()
    ]
    channels = [
        {"sampler": number, "target": {"node": 0, "path": path}}
        for number, path in enumerate(moved)
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
        "buffers": [{"byteLength": len(buffer.content)}],
    }
    return write_container(document, buffer.content)


def write_container(document: dict[str, Any], binary: bytes | bytearray) -> bytes:
    """Join the parts of a GLB file; `binary` is a whole number of 4 bytes."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    parts = [
        part
        for kind, data in ((JSON, text), (BINARY, binary))
        for part in (len(data).to_bytes(4, "little"), kind, data)
    ]
    length = 12 + sum(map(len, parts))
    return b"".join((MAGIC, VERSION.to_bytes(4, "little"), length.to_bytes(4, "little"), *parts))


def to_quaternions(matrices: Floats) -> Floats:
    """Turn rotations over time into unit quaternions (x, y, z, w) without jumps of sign.

    Parameters
    ----------
    matrices : (frames, 3, 3) float64

    Returns
    -------
    (frames, 4) float64
        Each on the same side as the one before, so that a player turns the short way.
    """
    quaternions: Floats = scipy.spatial.transform.Rotation.from_matrix(matrices).as_quat()
    turns = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(turns)[:, None]
    return quaternions


class _Buffer:
    """The one block of bytes, grown array by array."""

    def __init__(self) -> None:
        self.accessors: list[dict[str, Any]] = []
        self.views: list[dict[str, Any]] = []
        self.content = bytearray()

    def add(
        self, values: Array, kind: str, target: int | None = None, *, bounds: bool = False
    ) -> int:
        """Append an array and return its accessor."""
        is_index = values.dtype.kind == "u"
        plain: Array = values if is_index else single_precision(values, "A number")
        array = np.ascontiguousarray(plain, dtype="<u4" if is_index else "<f4")
        rows = array.reshape(len(array), -1)
        # All types are of four bytes, so every array begins at a whole number of them.
        view = {"buffer": 0, "byteOffset": len(self.content), "byteLength": array.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": _UINT if is_index else _FLOAT,
                "count": len(rows),
                "type": kind,
            }
        )
        if bounds:
            # Of the numbers as written, float32.
            self.accessors[-1] |= {"min": rows.min(axis=0).tolist(), "max": rows.max(0).tolist()}
        self.content += array.tobytes()
        return len(self.accessors) - 1


def _extras(animation: MorphAnimation, least: Floats, spans: Floats) -> dict[str, Any]:
    times, topology = animation.times, animation.topology
    stated = {
        "unit": animation.unit,
        "unit_unknown": True if animation.unit is None else None,
        "times_unknown": True if times is None else None,
        "start_time": None if times is None or not times[0] else float(times[0]),
        "topology": None if topology is None else topology.name,
        "grid": None if animation.grid is None else list(animation.grid),
    }
    return {
        "weight_ranges": np.stack([least, least + spans], axis=1).tolist(),
        "targets_left_out": animation.n_left_out,
        "rms_left_out": animation.rms_left_out,
        **{name: value for name, value in stated.items() if value is not None},
    }
