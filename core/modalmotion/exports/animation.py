"""Animated meshes of modes and of motions in them."""

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from modalmotion.errors import LimitError, ParameterError
from modalmotion.formats.glb_writing import MorphAnimation
from modalmotion.hdf5.image import Dataset, Form, json_text
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.mesh.alignment import reference_positions
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes import Oscillators, State, free_response
from modalmotion.representation import Floats, shown
from modalmotion.signature import making, reconstruction
from modalmotion.template import Template, body_frame
from modalmotion.template.template import shapes_of
from modalmotion.template.vibration_modes import VibrationModes


def modal_animation(
    signature: making.ModalSignature,
    sequence: MeshSequence,
    max_targets: int | None = None,
    *,
    template: Template | None = None,
) -> MorphAnimation:
    """Convert a signature to targets and weights that play the same as `reconstruct`.

    Each mode and direction is one target, its amplitude the weight; those with most motion come
    first. The mean translation and the rotation move the mesh as a whole.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from: its reference frame gives the shape to deform.
    max_targets : int, optional
        Largest number of targets; `rms_left_out` is the error this causes.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Returns
    -------
    MorphAnimation
        The same positions as `reconstruct`, to rounding, if no target is left out.

    Raises
    ------
    ParameterError
        If the sequence is not the one the signature was made from, or `max_targets` is
        negative.
    """
    parameters = signature.parameters
    used = reconstruction.fitted_on(signature, sequence, template)
    if max_targets is not None and max_targets < 0:
        raise ParameterError(f"{max_targets} targets were requested.", remedy="Ask for 0 or more.")
    along_normal = signature.kind == making.SignatureKind.NORMAL_DISPLACEMENT
    if along_normal or parameters.components != body_frame.Components.CARTESIAN:
        raise ParameterError(
            "The amplitudes are along directions that differ by vertex; a target has one.",
            remedy="Fit with kind = material and components = cartesian, or write the superposed "
            "surfaces.",
        )
    start = reference_positions(sequence, parameters.reference)
    centre = used.weights @ start
    # (2) u = sum_p a_p phi_p, each shape taken about its own mean, which moves the whole.
    phi = shapes_of(signature.modes, used)
    means = used.weights @ phi
    a = signature.amplitudes
    drift = np.einsum("m,fmd->fd", means, a)
    phi = phi - means
    # Mean squares are relative to the largest amplitude: those of extreme ones overflow or vanish.
    scale = float(np.abs(a).max(initial=0.0)) or 1.0
    shares = (a / scale) ** 2
    energy = ((used.weights @ phi**2)[:, None] * shares.mean(axis=0)).ravel()
    order = np.argsort(-energy, kind="stable")
    moving = order[energy[order] > 0]
    taken = moving if max_targets is None else moving[:max_targets]
    modes, directions = np.divmod(taken, 3)
    targets = np.zeros((len(taken), *start.shape), dtype=np.float32)
    targets[np.arange(len(taken)), :, directions] = phi[:, modes].T
    left_out = moving[len(taken) :]
    is_left = np.zeros(a.shape[1] * 3)
    is_left[left_out] = 1.0
    lost = np.einsum("vm,fmd->fvd", phi, a / scale * is_left.reshape(-1, 3))
    rms = scale * float(np.sqrt((lost**2).sum(axis=2).mean()))
    labels = signature.modes.labels
    return MorphAnimation(
        base=start - centre,
        targets=targets,
        target_names=tuple(f"{labels[k // 3]} {'xyz'[k % 3]}" for k in taken.tolist()),
        weights=a.reshape(len(a), -1)[:, taken],
        rotations=signature.rotations.matrices,
        translations=centre + drift,
        faces=sequence.faces,
        times=signature.times,
        unit=sequence.unit,
        topology=sequence.topology,
        grid=sequence.grid,
        n_left_out=len(left_out),
        rms_left_out=rms if len(left_out) else 0.0,
    )


FORM: Final = Form("vibration_modes", 2)


def modes_to_npz(modes: VibrationModes) -> bytes:
    """Write `modes` (labels), `angular_frequencies` and `shapes` as .npz."""
    buffer = io.BytesIO()
    np.savez(
        buffer,
        modes=np.array([str(label) for label in modes.labels]),
        angular_frequencies=modes.angular_frequencies,
        shapes=modes.shapes,
    )
    return buffer.getvalue()


def modes_to_hdf5(modes: VibrationModes) -> bytes:
    """Write labels, angular frequencies and shapes as a sealed HDF5 file."""
    labels = [str(label) for label in modes.labels]
    datasets = [
        Dataset("angular_frequencies", modes.angular_frequencies, modes.frequency_unit, "mode"),
        Dataset("shapes", modes.shapes, "1", "vertex, mode"),
        json_text("labels", {"labels": labels, "notes": modes.notes}),
    ]
    return FORM.image({}, datasets, topology=modes.surface)


# If modes are shown one by one: frames of each, s, and amplitude as a share of the surface.
_FRAMES_OF_EACH: Final = 24
_SECONDS_OF_EACH: Final = 1.0
_REACH: Final = 0.15


@shown("modes", "amplitudes", "unit")
@dataclass(frozen=True, eq=False)
class Swing:
    """A surface moved by modes along one direction: x(t) = X + (Phi a(t)) d.

    Parameters
    ----------
    template : Template
        X, the surface at rest.
    modes : VibrationModes
        Phi.
    direction : (vertices, 3) float64
        d, a unit vector at each vertex.
    amplitudes : (frames, modes) float64, length unit
        a(t).
    times : (frames,) float64, s
    unit : str or None
    """

    template: Template
    modes: VibrationModes
    direction: Floats
    amplitudes: Floats
    times: Floats
    unit: str | None

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.times)

    def heights(self) -> Iterator[Floats]:
        """Displacement of each vertex along its direction, (vertices,) for each frame."""
        return ((self.modes.shapes @ a[:, None])[:, 0] for a in self.amplitudes)

    def positions(self) -> Iterator[Floats]:
        """Positions, (vertices, 3) for each frame; memory does not grow with their number."""
        start = self.template.vertices
        # (2) x = X + sum_m a_m phi_m d
        return (start + height[:, None] * self.direction for height in self.heights())

    def sequence(self) -> MeshSequence:
        """All frames as a mesh sequence.

        Raises
        ------
        LimitError
            If they would need more memory than a file may.
        """
        size = self.n_frames * self.template.vertices.nbytes
        most = DEFAULT_LIMITS.decompressed_bytes
        if size > most:
            raise LimitError(
                f"{self.n_frames} frames of {self.template.n_vertices} vertices take {size} bytes; "
                f"at most {most} may be in memory at once.",
                remedy="Ask for fewer frames, or write GLB, which contains modes only.",
                limit="decompressed_bytes",
                details={"value": size, "most": most},
            )
        return mesh_sequence(
            np.stack([*self.positions()]),
            self.template.faces,
            topology=self.template.surface,
            times=self.times,
            unit=self.unit,
        )

    def morph_animation(self) -> MorphAnimation:
        """Modes as morph targets, amplitudes as their weights."""
        targets = [phi[:, None] * self.direction for phi in self.modes.shapes.T]
        return MorphAnimation(
            base=self.template.vertices,
            targets=np.stack(targets),
            target_names=tuple(map(str, self.modes.labels)),
            weights=self.amplitudes,
            rotations=np.broadcast_to(np.eye(3), (self.n_frames, 3, 3)),
            translations=np.zeros((self.n_frames, 3)),
            faces=self.template.faces,
            times=self.times,
            unit=self.unit,
            topology=self.template.surface,
        )


def swing(
    template: Template,
    modes: VibrationModes,
    amplitudes: Floats,
    direction: Floats,
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
    for label, amplitude in zip(modes.labels, a.tolist(), strict=True):
        if not math.isfinite(amplitude):
            what = f"The amplitude of {label} is {amplitude}."
            raise ParameterError(what, remedy="Use a finite amplitude.")
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
    return Swing(template, modes, direction, states.amplitudes, times, unit)


def one_by_one(
    template: Template, modes: VibrationModes, direction: Floats, unit: str | None = None
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
    return Swing(template, modes, direction, amplitudes, times, unit)


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
