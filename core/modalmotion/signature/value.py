"""The modal signature: the whole answer about one sequence."""

from dataclasses import dataclass, replace
from importlib import import_module
from typing import Final

import numpy as np

from modalmotion import mesh, template
from modalmotion.arguments.checking import Plotted, Saved
from modalmotion.mesh import alignment, spring_modes
from modalmotion.modes.topologies import MESH, Topology
from modalmotion.notes import Note
from modalmotion.numeric.scales import root_mean_square
from modalmotion.representation import Floats, shown
from modalmotion.signature.choice import ModelChoice
from modalmotion.signature.parameters import SignatureKind, SignatureParameters
from modalmotion.template.body_frame import Components, body_frame

LENGTHS_OF_FRAMES: Final = (
    *("rms_errors", "weighted_rms_errors", "p95_errors", "max_errors"),
    *("motion_rms", "weighted_motion_rms"),
)
"""Attributes of a signature with one length for each frame."""


@shown("surface", "n_frames", "modes", "rms_error:unit", "sequence_id")
@dataclass(frozen=True, eq=False)
class ModalSignature(Saved, Plotted):
    """Amplitude trajectory of a sequence, with its error and where it comes from.

    Parameters
    ----------
    modes : Modes
        In closed form; or, where the surface has no natural coordinates, of its own mesh.
    amplitudes : (frames, modes, n) float64, `unit`
        Along the three directions that `parameters.components` names; of normal displacements
        (n = 1) along the reference's outward normals.
    angular_frequencies : (modes,) float64, rad per s
        Continuum limit w = c k on `lengths`, with c = 1 length unit per s.
    rotations : Rotations
        The rotation trajectory, removed before the fit.
    reference_amplitudes : (modes, 3) float64, `unit`
        Amplitudes of the reference itself, of its positions from its centroid; zero where the
        components are cylindrical.
    volumes : (frames,) float64, `unit` cubed, or None
        Volume that the vertices enclose in each frame, openings closed, where it was requested
        (`parameters.volumes`) and the surface encloses one: see `Cavity.volume`.
    translations : (frames, 3) float64, `unit`
        Path of the weighted centroid from the reference's. It is part of the amplitudes too,
        and needed beside them where they are not along x, y, z. Of normal displacements: path of
        the surface's area centroid, which was removed before the fit.
    rms_errors, p95_errors, max_errors : (frames,) float64, `unit`
        RMS, 95th percentile and maximum of the distances between vertices and their
        reconstruction in each frame, over all vertices alike: docs/error.md. Of normal
        displacements: between the surface and the reconstruction, along the normal at each vertex
        of the reference.
    weighted_rms_errors : (frames,) float64, `unit`
        RMS of these distances over the surface, each vertex by its share of it.
    motion_rms, weighted_motion_rms : (frames,) float64, `unit`
        RMS displacement from the reference: the RMS errors with no modes.
    times : (frames,) float64, s, or None
    unit : str or None
    n_vertices : int
    lengths : tuple of float, `unit`
        Along each natural coordinate.
    landmarks : Landmarks or None
        Axis and zero of theta; None where the surface has no axis.
    condition : float
        Of the weighted shapes: factor of the data's precision that amplitudes may lose.
    parameters : SignatureParameters
        As requested; `modes` may have been rounded up, or be None.
    sequence_id, template_id : str
    notes : tuple of Note
        Caveats for the user.
    provenance : dict
        Versions of the software that made it.
    amplitude_deviations : (frames, modes, n) float64, `unit`, or None
        Standard deviation of each amplitude, where it is known: from a track, or from the noise
        that was estimated (`parameters.deviations` or `parameters.auto`). Zero in the frame that
        motion is measured from. The template is taken as exact, and limits on `harmonics` as none.
    choice : ModelChoice or None
        How the modes were chosen, where their number was not stated.
    facts : Facts
        Those of the sequence.
    """

    modes: spring_modes.Modes
    amplitudes: Floats
    angular_frequencies: Floats
    rotations: alignment.Rotations
    reference_amplitudes: Floats
    volumes: Floats | None
    translations: Floats
    rms_errors: Floats
    weighted_rms_errors: Floats
    p95_errors: Floats
    max_errors: Floats
    motion_rms: Floats
    weighted_motion_rms: Floats
    times: Floats | None
    unit: str | None
    n_vertices: int
    lengths: tuple[float, ...]
    landmarks: template.Landmarks | None
    condition: float
    parameters: SignatureParameters
    sequence_id: str
    template_id: str
    notes: tuple[Note, ...]
    provenance: dict[str, str]
    choice: ModelChoice | None = None
    amplitude_deviations: Floats | None = None
    facts: mesh.Facts = mesh.NO_FACTS

    def _repr_html_(self) -> str:
        """Write it as notebooks show it."""
        # By the public list, which stands above everything: values import nothing above them.
        return str(import_module("modalmotion").to_html(self))

    @property
    def kind(self) -> SignatureKind:
        """What the amplitudes are of: displacements of points, or of the surface along normals."""
        return self.parameters.kind

    @property
    def topology(self) -> Topology | None:
        """Topology whose modes were fitted; None for the spring modes of one mesh."""
        return self.modes.topology

    @property
    def surface(self) -> str:
        """Name of the topology, or "mesh" for the spring modes of one mesh."""
        return MESH if self.topology is None else self.topology.name

    @property
    def body_amplitudes(self) -> Floats:
        """Amplitudes in the frame of the body, in which patients compare.

        Returns
        -------
        (frames, modes, n) float64, `unit`
            Along theta_zero, across it, and along the axis; radial, tangential and axial ones
            are in that frame already, and so are normal displacements; so, by convention, are those
            of a surface without an axis.
        """
        is_cartesian = self.parameters.components == Components.CARTESIAN
        if self.landmarks is None or not is_cartesian or self.kind != SignatureKind.MATERIAL:
            return self.amplitudes
        return np.asarray(self.amplitudes @ body_frame(self.landmarks).T)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.amplitudes)

    @property
    def rms_error(self) -> float:
        """RMS error over all vertices and frames, `unit`."""
        return root_mean_square(self.rms_errors)

    @property
    def weighted_rms_error(self) -> float:
        """RMS error over the surface and all frames, `unit`."""
        return root_mean_square(self.weighted_rms_errors)

    @property
    def max_error(self) -> float:
        """Largest error of any vertex in any frame, `unit`."""
        return float(self.max_errors.max())

    @property
    def deviation_share(self) -> float | None:
        """RMS deviation of the amplitudes over the RMS of their motion; None where not known.

        Of all amplitudes and frames together: above 1 what is stated is mostly error.
        """
        if self.amplitude_deviations is None:
            return None
        moved = float(np.linalg.norm(self.amplitudes))
        error = float(np.linalg.norm(self.amplitude_deviations))
        if error == 0.0:
            return 0.0
        return error / moved if moved > 0.0 else float("inf")

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
        usual = root_mean_square(np.linalg.norm(np.diff(a, axis=0), axis=(1, 2)))
        return float(np.linalg.norm(a[-1] - a[0])) / usual if usual > 0 else 0.0

    @property
    def deformation_spectrum(self) -> Floats:
        """RMS amplitude of each mode over frames, directions added, (modes,) float64, `unit`."""
        scale = np.abs(self.amplitudes).max(initial=0.0)
        if scale == 0.0:
            return np.zeros(len(self.modes))
        squares = ((self.amplitudes / scale) ** 2).sum(axis=2).mean(axis=0)
        return np.asarray(scale * np.sqrt(squares))

    @property
    def strain_energy(self) -> Floats:
        """Strain energy ``w^2 |a|^2 / 2`` of each mode, (frames, modes), per mass, s^-2."""
        velocities = self.angular_frequencies[:, None] * self.amplitudes
        return np.asarray(0.5 * (velocities**2).sum(axis=2))

    @property
    def n_amplitudes(self) -> int:
        """Number of amplitudes of one frame."""
        return len(self.modes) * self.parameters.n_directions

    @property
    def compression(self) -> float:
        """Coordinates over amplitudes of one frame, 3N / 3 modes, as in Nastar 1994."""
        return 3 * self.n_vertices / self.n_amplitudes

    @property
    def compression_of_sequence(self) -> float:
        """Numbers in the whole sequence over those to keep: amplitudes and the reference."""
        coordinates = 3 * self.n_vertices
        return self.n_frames * coordinates / (self.n_frames * self.n_amplitudes + coordinates)


def whole_count(modes: spring_modes.Modes, n: int) -> int:
    """Give the number of first modes, at least n, that splits no cosine-sine pair."""
    counts = spring_modes.whole_counts(modes)
    return int(counts[min(int(np.searchsorted(counts, n)), len(counts) - 1)])


def first_modes(signature: ModalSignature, n: int) -> ModalSignature:
    """Keep the first modes alone, with the amplitudes that the fit of all modes gave them.

    Parameters
    ----------
    signature : ModalSignature
    n : int
        At most as many as it has. Its errors and notes stay those of all.

    Returns
    -------
    ModalSignature
    """
    if n == len(signature.modes):
        return signature
    deviations = signature.amplitude_deviations
    return replace(
        signature,
        modes=signature.modes.take(np.arange(n)),
        amplitudes=signature.amplitudes[:, :n],
        angular_frequencies=signature.angular_frequencies[:n],
        reference_amplitudes=signature.reference_amplitudes[:n],
        amplitude_deviations=None if deviations is None else deviations[:, :n],
    )
