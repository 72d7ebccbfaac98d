"""Oscillating modes added to a surface, as in figure 3 of Nastar (1994), and their files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.dynamics import Oscillators, State, free_response
from modalmotion.dynamics.animation import animate_along, directional_mode
from modalmotion.errors import LimitError, ParameterError
from modalmotion.formats import MorphAnimation
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import Topology
from modalmotion.numeric.products import product
from modalmotion.representation import shown
from modalmotion.template import Template
from modalmotion.template.vibration_modes import VibrationModes

Array = NDArray[np.float64]

# If modes are shown one by one: frames of each, s, and amplitude as a share of the surface.
_FRAMES_OF_EACH: Final = 24
_SECONDS_OF_EACH: Final = 1.0
_REACH: Final = 0.15


@shown("names", "amplitudes", "reference", "unit")
@dataclass(frozen=True, eq=False)
class Swing:
    """A surface moved by modes along one direction: x(t) = X + (Phi a(t)) d.

    Parameters
    ----------
    reference : (vertices, 3) float64, length unit
        X, the surface at rest.
    faces : (faces, 3) int64
    shapes : (vertices, modes) float64
        Phi.
    names : tuple of str
        Of the modes.
    direction : (vertices, 3) float64
        d, a unit vector at each vertex.
    amplitudes : (frames, modes) float64, length unit
        a(t).
    times : (frames,) float64, s
    unit : str or None
    topology : Topology or None
    """

    reference: Array
    faces: NDArray[np.int64]
    shapes: Array
    names: tuple[str, ...]
    direction: Array
    amplitudes: Array
    times: Array
    unit: str | None
    topology: Topology | None

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.times)

    def heights(self) -> Iterator[Array]:
        """Displacement of each vertex along its direction, (vertices,) for each frame."""
        return (product(self.shapes, a[:, None])[:, 0] for a in self.amplitudes)

    def positions(self) -> Iterator[Array]:
        """Positions, (vertices, 3) for each frame; memory does not grow with their number."""
        return animate_along(self.reference, self.shapes, self.amplitudes, self.direction)

    def sequence(self) -> MeshSequence:
        """All frames as a mesh sequence.

        Raises
        ------
        LimitError
            If they would need more memory than a file may.
        """
        size = self.n_frames * self.reference.nbytes
        most = DEFAULT_LIMITS.decompressed_bytes
        if size > most:
            raise LimitError(
                f"{self.n_frames} frames of {len(self.reference)} vertices take {size} bytes; "
                f"at most {most} may be in memory at once.",
                remedy="Ask for fewer frames, or write GLB, which contains modes only.",
                limit="decompressed_bytes",
                details={"value": size, "most": most},
            )
        return mesh_sequence(
            np.stack([*self.positions()]),
            self.faces,
            topology=self.topology,
            times=self.times,
            unit=self.unit,
        )

    def morph_animation(self) -> MorphAnimation:
        """Modes as morph targets, amplitudes as their weights."""
        targets = [directional_mode(phi, self.direction) for phi in self.shapes.T]
        return MorphAnimation(
            base=self.reference,
            targets=np.stack(targets),
            target_names=self.names,
            weights=self.amplitudes,
            rotations=np.broadcast_to(np.eye(3), (self.n_frames, 3, 3)),
            translations=np.zeros((self.n_frames, 3)),
            faces=self.faces,
            times=self.times,
            unit=self.unit,
            topology=self.topology,
        )


def swing(
    template: Template,
    modes: VibrationModes,
    amplitudes: Array,
    direction: Array,
    *,
    n_frames: int = 48,
    seconds: float = 2.0,
    damping: float = 0.0,
    together: bool = False,
    unit: str | None = None,
) -> Swing:
    """Displace a surface by modes and release it: each oscillates at its own frequency.

    Parameters
    ----------
    template : Template
    modes : VibrationModes
        Of that template.
    amplitudes : (modes,) float64, `unit`
        At the start. Frame 0 is their superposition.
    direction : (vertices, 3) float64
        Unit vectors.
    n_frames : int
        Over one period of the slowest mode; the last is one step before its end.
    seconds : float
        Duration of that period in the animation: time is scaled, ratios of frequencies are kept.
    damping : float
        Share of the critical damping of each mode.
    together : bool
        All modes oscillate with that period, regardless of their frequencies.
    unit : str, optional

    Raises
    ------
    ParameterError
        If an amplitude, the damping or the duration is not finite, or `n_frames` is below 1.
    LimitError
        If there are too many frames.
    """
    a = np.asarray(amplitudes, dtype=np.float64)
    wrong = np.flatnonzero(~np.isfinite(a))
    if wrong.size:
        label = modes.labels[int(wrong[0])]
        raise ParameterError(
            f"The amplitude of {label} is {a[wrong[0]]}.", remedy="Use a finite amplitude."
        )
    _require_frames(n_frames, seconds)
    if not (math.isfinite(damping) and damping >= 0):
        raise ParameterError(
            f"A damping of {damping} does not damp.", remedy="Use a finite share of at least 0."
        )
    w = modes.angular_frequencies
    slowest = float(w[w > 0].min(initial=math.inf))
    relative = (w > 0).astype(np.float64) if together else w / slowest
    # (3) u'' + c u' + w^2 u = 0 from u = a, u' = 0, w in turns of the slowest mode.
    omega = 2.0 * np.pi / seconds * relative
    times = np.linspace(0.0, seconds, n_frames, endpoint=False)
    states = free_response(
        Oscillators(omega, 2.0 * damping * omega), times, State(a, np.zeros_like(a))
    )
    return _swing(template, modes, direction, states.amplitudes, times, unit)


def one_by_one(
    template: Template, modes: VibrationModes, direction: Array, unit: str | None = None
) -> Swing:
    """Show modes one after the other, each for one oscillation, with a visible amplitude.

    Parameters
    ----------
    template : Template
    modes : VibrationModes
    direction : (vertices, 3) float64
    unit : str, optional
    """
    n = len(modes)
    _require_frames(n * _FRAMES_OF_EACH + 1, _SECONDS_OF_EACH)
    extent = np.ptp(template.vertices, axis=0).max() / 2
    reach = _REACH * extent / np.abs(modes.shapes).max(axis=0)
    amplitudes = np.zeros((n * _FRAMES_OF_EACH + 1, n))
    turn = np.sin(2.0 * np.pi * np.arange(_FRAMES_OF_EACH) / _FRAMES_OF_EACH)
    for mode in range(n):
        first = mode * _FRAMES_OF_EACH
        amplitudes[first : first + _FRAMES_OF_EACH, mode] = reach[mode] * turn
    times = np.linspace(0.0, n * _SECONDS_OF_EACH, len(amplitudes))
    return _swing(template, modes, direction, amplitudes, times, unit)


def _swing(
    template: Template,
    modes: VibrationModes,
    direction: Array,
    amplitudes: Array,
    times: Array,
    unit: str | None,
) -> Swing:
    names = tuple(map(str, modes.labels))
    return Swing(
        *(template.vertices, template.faces, modes.shapes, names, direction),
        *(amplitudes, times, unit, template.surface),
    )


def _require_frames(n_frames: int, seconds: float) -> None:
    if n_frames < 1 or not (math.isfinite(seconds) and seconds > 0):
        raise ParameterError(
            f"{n_frames} frames over {seconds} s are not an animation.",
            remedy="Ask for at least one frame, and a finite time above zero.",
        )
    if n_frames > DEFAULT_LIMITS.frames:
        raise LimitError(
            f"{n_frames} frames were requested; at most {DEFAULT_LIMITS.frames} are allowed.",
            remedy="Ask for fewer frames.",
            limit="frames",
            details={"value": n_frames, "most": DEFAULT_LIMITS.frames},
        )
