"""Animations of a glTF file: channels between keyframes (glTF 2.0, app. C), and weighted targets.

Rotations are unit quaternions (x, y, z, w), as glTF stores them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import scipy
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.formats.gltf.container import Container, malformed, read_accessor
from modalmotion.limits import ReadLimits
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import Topology
from modalmotion.representation import shown


def to_quaternions(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn rotations over time into quaternions without jumps of sign.

    Parameters
    ----------
    matrices : (frames, 3, 3) float64

    Returns
    -------
    (frames, 4) float64
        Each on the same side as the one before, so that a player turns the short way.
    """
    quaternions: NDArray[np.float64] = scipy.spatial.transform.Rotation.from_matrix(
        matrices
    ).as_quat()
    turns = np.where((quaternions[1:] * quaternions[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    quaternions[1:] *= np.cumprod(turns)[:, None]
    return quaternions


_COMPONENTS: Final = {"translation": 3, "rotation": 4, "scale": 3, "weights": 1}
_MODES: Final = ("LINEAR", "STEP", "CUBICSPLINE")

Key = tuple[int, str]


@dataclass(frozen=True, eq=False)
class Channel:
    """Values of one property of a node at its keyframes.

    Parameters
    ----------
    path : {"translation", "rotation", "scale", "weights"}
    mode : {"LINEAR", "STEP", "CUBICSPLINE"}
    times : (keys,) float64, s
    values : (keys, parts, n) float64
        One part; in-tangent, value and out-tangent for splines.
    """

    path: str
    mode: str
    times: NDArray[np.float64]
    values: NDArray[np.float64]

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at any times, held before the first and after the last key, (times, n)."""
        keys = self.values[:, self.values.shape[1] // 2]
        t = np.clip(times, self.times[0], self.times[-1])
        left = np.minimum(np.searchsorted(self.times, t, "right") - 1, max(len(keys) - 2, 0))
        if self.mode == "STEP" or len(keys) == 1:
            return keys[np.searchsorted(self.times, t, "right") - 1]
        if self.mode == "CUBICSPLINE":
            d = (self.times[left + 1] - self.times[left])[:, None]
            s = (t - self.times[left])[:, None] / d
            # p(s) = (2s^3-3s^2+1) p0 + (s^3-2s^2+s) m0 + (-2s^3+3s^2) p1 + (s^3-s^2) m1
            value = (
                (2 * s**3 - 3 * s**2 + 1) * keys[left]
                + (s**3 - 2 * s**2 + s) * d * self.values[left, 2]
                + (-2 * s**3 + 3 * s**2) * keys[left + 1]
                + (s**3 - s**2) * d * self.values[left + 1, 0]
            )
            return np.asarray(value, dtype=np.float64)
        if self.path == "rotation":
            turns = scipy.spatial.transform.Rotation.from_quat(keys)
            turned: NDArray[np.float64] = scipy.spatial.transform.Slerp(self.times, turns)(
                t
            ).as_quat()
            return turned
        return np.stack([np.interp(t, self.times, column) for column in keys.T], axis=1)


def read_channels(
    container: Container, name: str | None, limits: ReadLimits
) -> tuple[dict[Key, Channel], list[str]]:
    """Read the channels of one animation.

    Parameters
    ----------
    container : Container
    name : str or None
        The first animation by default.
    limits : ReadLimits

    Returns
    -------
    channels : dict of (node, path) to Channel
    others : list of str
        Names of the animations that were not read.

    Raises
    ------
    ParameterError
        If no animation has that name.
    MalformedFileError
        If a channel cannot be read.
    """
    animations = container.document.get("animations", [])
    names = [str(a.get("name", i)) for i, a in enumerate(animations)]
    if name is not None and name not in names:
        raise ParameterError(
            f"There is no animation {name[:40]!r}; there are {', '.join(names[:8]) or 'none'}.",
            remedy="Name one of them, or leave the name out for the first.",
        )
    if not animations:
        return {}, []
    index = 0 if name is None else names.index(name)
    animation = container.item("animations", index)
    samplers = Container({"samplers": animation["samplers"]}, container.binary)

    @cache
    def channel(number: int, path: str) -> Channel:
        # Many nodes may move by the same numbers.
        return _channel(container, samplers.item("samplers", number), path, limits)

    targets = [(listed.get("sampler"), listed["target"]) for listed in animation["channels"]]
    channels = {
        (target["node"], target["path"]): channel(number, target["path"])
        for number, target in targets
        if target.get("node") is not None and target.get("path") in _COMPONENTS
    }
    return channels, [other for i, other in enumerate(names) if i != index]


def _channel(
    container: Container, sampler: Mapping[str, Any], path: str, limits: ReadLimits
) -> Channel:
    mode = sampler.get("interpolation", "LINEAR")
    times = read_accessor(container, sampler.get("input"), 1, limits, "frames")[:, 0]
    values = read_accessor(container, sampler.get("output"), _COMPONENTS[path], limits)
    n_parts = 3 if mode == "CUBICSPLINE" else 1
    is_whole = len(times) > 0 and values.size % (len(times) * n_parts) == 0
    if mode not in _MODES or times.dtype != np.float64 or not is_whole or not values.size:
        raise malformed(
            f"An animation of the GLB file has {len(times)} keys and {len(values)} values "
            f"({str(mode)[:20]}) for {path}."
        )
    if not (np.isfinite(times).all() and np.isfinite(values).all() and (np.diff(times) > 0).all()):
        raise malformed(
            "An animation of the GLB file has keys that are not finite or do not increase."
        )
    shaped = values.astype(np.float64).reshape(len(times), n_parts, -1)
    if path != "weights" and shaped.shape[2] != _COMPONENTS[path]:
        raise malformed(f"An animation of the GLB file has too many values for {path}.")
    return Channel(path, mode, times, shaped)


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

    base: NDArray[np.float64]
    targets: NDArray[np.float64] | NDArray[np.float32]
    target_names: tuple[str, ...]
    weights: NDArray[np.float64]
    rotations: NDArray[np.float64]
    translations: NDArray[np.float64]
    faces: NDArray[np.int64]
    times: NDArray[np.float64] | None = None
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
                    details={"array": name, "shape": list(array.shape)},
                )

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.weights)

    def positions(self) -> NDArray[np.float64]:
        """Positions of all frames, (frames, vertices, 3) float64, in `unit`."""
        u = np.tensordot(self.weights, self.targets, axes=(1, 0))
        # x(t) = R(t) (base + u(t)) + T(t)
        x: NDArray[np.float64] = np.matmul(self.base + u, self.rotations.transpose(0, 2, 1))
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
