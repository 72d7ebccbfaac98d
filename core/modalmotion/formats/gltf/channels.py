"""Animation channels of a glTF file and their values between keyframes (glTF 2.0, app. C)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.formats.gltf.accessors import read_accessor
from modalmotion.formats.gltf.container import Container, malformed
from modalmotion.formats.gltf.quaternions import slerp
from modalmotion.limits import ReadLimits

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
        left = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(keys) - 1)
        right = np.minimum(left + 1, len(keys) - 1)
        length = self.times[right] - self.times[left]
        inside = np.clip(times - self.times[left], 0.0, length)
        s = np.divide(inside, length, out=np.zeros_like(inside), where=length > 0)[:, None]
        if self.mode == "STEP":
            return keys[left]
        if self.mode == "CUBICSPLINE":
            d = length[:, None]
            out, into = d * self.values[left, 2], d * self.values[right, 0]
            # p(s) = (2s^3-3s^2+1) p0 + (s^3-2s^2+s) m0 + (-2s^3+3s^2) p1 + (s^3-s^2) m1
            value = (
                (2 * s**3 - 3 * s**2 + 1) * keys[left]
                + (s**3 - 2 * s**2 + s) * out
                + (-2 * s**3 + 3 * s**2) * keys[right]
                + (s**3 - s**2) * into
            )
        elif self.path == "rotation":
            value = slerp(keys[left], keys[right], s)
        else:
            value = (1 - s) * keys[left] + s * keys[right]
        if self.path == "rotation":
            value = _unit_length(value)
        return np.asarray(value, dtype=np.float64)


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
    channels = {}
    # Many nodes may move by the same numbers.
    known: dict[tuple[int, str], Channel] = {}
    for listed in animation["channels"]:
        target = listed["target"]
        node, path = target.get("node"), target.get("path")
        if node is None or path not in _COMPONENTS:
            continue
        sampler = samplers.item("samplers", listed.get("sampler"))
        if (key := (listed["sampler"], path)) not in known:
            known[key] = _channel(container, sampler, path, limits)
        channels[node, path] = known[key]
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
    if path == "rotation" and n_parts == 1:
        shaped = _unit_length(shaped)
    if path != "weights" and shaped.shape[2] != _COMPONENTS[path]:
        raise malformed(f"An animation of the GLB file has too many values for {path}.")
    return Channel(path, mode, times, shaped)


def _unit_length(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    if not (length > 0).all():
        raise malformed("A rotation in the GLB file is a quaternion of zero length.")
    unit: NDArray[np.float64] = quaternions / length
    return unit
