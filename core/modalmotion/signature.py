"""The modal signature: everything an answer says of one sequence."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from importlib.metadata import version
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.body_frame import Components, body_frame
from modalmotion.errors import ParameterError
from modalmotion.fit import fit_sequence, make_basis
from modalmotion.modes import ModeSet
from modalmotion.rigid import Rotations
from modalmotion.sequence import MeshSequence
from modalmotion.signature_parameters import MOST_MODES, SignatureParameters
from modalmotion.spring_modes import SpringModes, SpringSpectrum
from modalmotion.template import (
    Landmarks,
    Template,
    choose_modes,
    frequencies_on,
    make_template,
    require_same_mesh,
)
from modalmotion.topology import Topology

__all__ = [
    "INTENDED_USE",
    "MOST_MODES",
    "ModalSignature",
    "SignatureParameters",
    "modal_signature",
    "provenance",
    "resolve_sequence",
    "resolve_template",
]

INTENDED_USE: Final = (
    "Description of surface motion for research and tool development. Not a medical device; "
    "not for diagnosis."
)


@dataclass(frozen=True, eq=False)
class ModalSignature:
    """Amplitude trajectory of a sequence, with its error and where it comes from.

    Parameters
    ----------
    modes : ModeSet or SpringSpectrum
        In closed form; or, where the surface has no natural coordinates, of its own mesh.
    amplitudes : (frames, modes, 3) float64, `unit`
        Along the directions that `parameters.components` names.
    angular_frequencies : (modes,) float64, rad per s
        Continuum limit w = c k on `lengths`, with c = `wave_speed`.
    rotations : Rotations
        The rotation trajectory, removed before the fit.
    translations : (frames, 3) float64, `unit`
        Path of the weighted centroid from the reference's. It is part of the amplitudes too,
        and needed beside them where they are not along x, y, z.
    rms_errors, p95_errors, max_errors : (frames,) float64, `unit`
        Distances between vertices and their reconstruction in each frame; RMS and 95th
        percentile are over the surface, the maximum over all vertices.
    motion_rms : (frames,) float64, `unit`
        RMS displacement from the reference: the error of no modes at all.
    times : (frames,) float64, s, or None
    unit : str or None
    n_vertices : int
    lengths : tuple of float, `unit`
        Along each natural coordinate.
    landmarks : Landmarks or None
        Axis and zero of theta; None where the surface has no axis.
    condition : float
        Of the weighted shapes: how much of the data's precision the amplitudes may lose.
    parameters : SignatureParameters
        As asked; `modes` may have been rounded up.
    sequence_id, template_id : str
    notes : tuple of str
        What was met on the way that a user should know.
    provenance : dict
        Versions of the software that made it.
    """

    modes: ModeSet | SpringSpectrum
    amplitudes: NDArray[np.float64]
    angular_frequencies: NDArray[np.float64]
    rotations: Rotations
    translations: NDArray[np.float64]
    rms_errors: NDArray[np.float64]
    p95_errors: NDArray[np.float64]
    max_errors: NDArray[np.float64]
    motion_rms: NDArray[np.float64]
    times: NDArray[np.float64] | None
    unit: str | None
    n_vertices: int
    lengths: tuple[float, ...]
    landmarks: Landmarks | None
    condition: float
    parameters: SignatureParameters
    sequence_id: str
    template_id: str
    notes: tuple[str, ...]
    provenance: dict[str, str]

    @property
    def topology(self) -> Topology | None:
        """Topology whose modes were fitted; None for the spring modes of one mesh."""
        return self.modes.topology

    @property
    def surface(self) -> str:
        """Name of the topology, or "mesh" for the spring modes of one mesh."""
        return "mesh" if self.topology is None else self.topology.name

    @property
    def body_amplitudes(self) -> NDArray[np.float64]:
        """Amplitudes in the frame of the body, in which patients compare.

        Returns
        -------
        (frames, modes, 3) float64, `unit`
            Along theta_zero, across it, and along the axis; radial, tangential and axial ones
            are of the body already, and so are those of a surface without an axis taken to be.
        """
        if self.landmarks is None or self.parameters.components != Components.CARTESIAN:
            return self.amplitudes
        turned: NDArray[np.float64] = self.amplitudes @ body_frame(self.landmarks).T
        return turned

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.amplitudes)

    @property
    def rms_error(self) -> float:
        """RMS error over all frames, `unit`."""
        return _root_mean_square(self.rms_errors)

    @property
    def max_error(self) -> float:
        """Largest error of any vertex in any frame, `unit`."""
        return float(self.max_errors.max())

    @property
    def closure_gap(self) -> float:
        """Distance of the last frame's amplitudes from the first's, over the usual step.

        Near 1 for one turn of a cycle whose next frame would be the first, 0 where the last
        frame repeats the first, large for a movement that does not come back; 0 without motion.
        """
        largest = float(np.abs(self.amplitudes).max(initial=0.0))
        if self.n_frames < 2 or largest == 0.0:
            return 0.0
        a = self.amplitudes / largest
        usual = _root_mean_square(np.linalg.norm(np.diff(a, axis=0), axis=(1, 2)))
        return float(np.linalg.norm(a[-1] - a[0])) / usual if usual > 0 else 0.0

    @property
    def deformation_spectrum(self) -> NDArray[np.float64]:
        """RMS amplitude of each mode over frames, directions added, (modes,) float64, `unit`."""
        scale = np.abs(self.amplitudes).max(initial=0.0)
        if scale == 0.0:
            return np.zeros(len(self.modes))
        squares = ((self.amplitudes / scale) ** 2).sum(axis=2).mean(axis=0)
        spectrum: NDArray[np.float64] = scale * np.sqrt(squares)
        return spectrum

    @property
    def strain_energy(self) -> NDArray[np.float64]:
        """w^2 |a|^2 / 2 of each mode, per unit mass, (frames, modes) float64, `unit`^2 per s^2."""
        velocities = self.angular_frequencies[:, None] * self.amplitudes
        energy: NDArray[np.float64] = 0.5 * (velocities**2).sum(axis=2)
        return energy

    @property
    def compression(self) -> float:
        """Coordinates over amplitudes of one frame, 3N / 3 modes, as in Nastar 1994."""
        return self.n_vertices / len(self.modes)

    @property
    def compression_of_sequence(self) -> float:
        """Numbers in the whole sequence over those to keep: amplitudes and the reference."""
        coordinates = 3 * self.n_vertices
        return self.n_frames * coordinates / (self.n_frames * 3 * len(self.modes) + coordinates)


def modal_signature(
    sequence: MeshSequence,
    parameters: SignatureParameters | None = None,
    *,
    template: Template | None = None,
) -> ModalSignature:
    """Fit closed-form modes to a sequence.

    Parameters
    ----------
    sequence : MeshSequence
    parameters : SignatureParameters, optional
        7 modes by default: 21 amplitudes a frame.
    template : Template, optional
        The one that the parameters name; made from the sequence's own reference by default.

    Returns
    -------
    ModalSignature

    Raises
    ------
    TopologyError
        If the stated topology does not fit the surface.
    ModeCountError
        If it cannot tell that many modes apart.
    ParameterError
        If there is no such reference frame.

    Notes
    -----
    Nastar, Vibration modes for nonrigid motion analysis in 3D images, INRIA 1994.
    """
    asked = SignatureParameters() if parameters is None else parameters
    given, sequence = sequence, resolve_sequence(sequence, asked)
    chosen = resolve_template(sequence, asked, template)
    choice = choose_modes(chosen, asked.modes, sequence.grid)
    modes = choice.modes
    basis = make_basis(chosen, modes)
    fit = fit_sequence(
        sequence,
        chosen,
        basis,
        reference=asked.reference,
        remove_rotation=asked.remove_rotation,
        components=asked.components,
    )
    notes = [*_notes_on_sequence(sequence, asked.reference), *chosen.notes, *choice.notes]
    undetermined = np.flatnonzero(~fit.rotations.is_determined)
    if undetermined.size:
        notes.append(
            f"The rotation is not determined in {undetermined.size} frames (first: frame "
            f"{undetermined[0]}): the points span less than a plane or fit several rotations."
        )
    if not fit.motion_rms.any():
        notes.append("Nothing moves: every frame equals the reference.")
    return ModalSignature(
        modes=modes.spectrum if isinstance(modes, SpringModes) else modes,
        amplitudes=fit.amplitudes,
        angular_frequencies=frequencies_on(chosen, modes, asked.wave_speed),
        rotations=fit.rotations,
        translations=_centroid_path(sequence, chosen.weights, asked.reference),
        rms_errors=fit.rms_errors,
        p95_errors=fit.p95_errors,
        max_errors=fit.max_errors,
        motion_rms=fit.motion_rms,
        times=sequence.times,
        unit=sequence.unit,
        n_vertices=sequence.n_vertices,
        lengths=chosen.lengths,
        landmarks=chosen.landmarks,
        condition=basis.condition,
        parameters=asked,
        sequence_id=given.id,
        template_id=chosen.id,
        notes=tuple(notes),
        provenance=provenance(),
    )


def resolve_sequence(sequence: MeshSequence, parameters: SignatureParameters) -> MeshSequence:
    """Return the sequence with the topology and grid that the parameters state over its own."""
    topology = None if parameters.topology is None else Topology.parse(parameters.topology)
    return sequence.with_topology(topology, parameters.grid)


def resolve_template(
    sequence: MeshSequence, parameters: SignatureParameters, template: Template | None = None
) -> Template:
    """Give the template that the parameters ask for: the one they name, or the sequence's own.

    Raises
    ------
    ParameterError
        If they name another than the one that is given, or one and none is given.
    TopologyError, ConnectivityError
        If the template is of another mesh.
    """
    if parameters.template is not None or template is not None:
        if template is None or template.id != parameters.template:
            raise ParameterError(
                f"The parameters name the template {str(parameters.template)[:12]}, but "
                f"{'none' if template is None else template.id[:12]} came.",
                remedy="Give the template that the parameters name.",
            )
        require_same_mesh(template, sequence)
        return template
    return make_template(
        sequence,
        reference=parameters.reference,
        weights=parameters.weights,
        landmarks=parameters.landmarks,
        closed_form=parameters.closed_form,
    )


def provenance() -> dict[str, str]:
    """Versions of everything that takes part in a result."""
    packages = ("modalmotion", "numpy", "scipy", "h5py")
    return {**{name: version(name) for name in packages}, "python": platform.python_version()}


def _centroid_path(
    sequence: MeshSequence, weights: NDArray[np.float64], reference: int
) -> NDArray[np.float64]:
    start = sequence.vertices[reference].astype(np.float64)
    path = np.empty((sequence.n_frames, 3))
    for frame, positions in enumerate(sequence.vertices):
        # einsum adds in one order whatever the number of threads.
        path[frame] = np.einsum("n,nc->c", weights, positions - start)
    return path


def _notes_on_sequence(sequence: MeshSequence, reference: int) -> list[str]:
    notes = []
    if sequence.n_frames == 1:
        notes.append("There is only one frame, so there is no motion to describe.")
    if sequence.unit is None:
        notes.append("The length unit is unknown; lengths are in the unit of the input.")
    if sequence.vertices.dtype == np.float32:
        positions = sequence.vertices[reference].astype(np.float64)
        extent = float(np.ptp(positions, axis=0).max())
        step = float(np.spacing(np.float32(np.abs(positions).max())))
        if extent > 0 and step > 1e-5 * extent:
            notes.append(
                f"The coordinates are stored as float32 far from the origin: they are rounded "
                f"to {step:.2g}, which no fit can undo. Store float64, or shift the origin."
            )
    return notes


def _root_mean_square(values: NDArray[np.float64]) -> float:
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0:
        return 0.0
    return largest * float(np.sqrt(((values / largest) ** 2).mean()))
