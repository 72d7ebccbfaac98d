"""Standard deviations of amplitudes, from the uncertainty of the positions.

To first order an amplitude is linear in the errors e of the positions. Its error is

    sum_v P_jv q_vi . (e_v - rho_v(e)),

e turned back as the frame is, P the projector of the fit, q_vi what component i of vertex v answers
to, and rho(e) the rigid motion that the fit takes out of e: for displacements the turn that fits
them best, taken on the reference; for normal displacements the path of the area centroid and the
turn that makes normal displacements least.

A normal displacement answers to the part of e along the normal n of the frame's surface, over the
cosine of its angle with the line that the normal displacement is measured on.

A template that is made of the sequence itself has axes with errors too, of the mean of all frames:
`turns_of_axes`. They and the errors above, which are differences between frames, are independent.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from modalmotion import errors, mesh
from modalmotion.mesh import alignment, geometry
from modalmotion.mesh.checks import Uncertainty
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference
from modalmotion.notes import Note
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import Floats
from modalmotion.signature.fit import Basis, Fit, Fitter, make_basis
from modalmotion.signature.noise import Noise, estimated
from modalmotion.signature.noise_bands import over_time
from modalmotion.template import Template
from modalmotion.template.axis import Placement

# Below this cosine the surface has turned away from the line: it meets it at the rim, whose
# points move along the line as they are.
_STEEP = 0.5

# Of the mean square radius: keeps the turn that the shape says nothing about.
_PULL = 1e-2

# Standard deviation, rad, of an angle that is not known at all.
_UNKNOWN = np.pi / np.sqrt(3.0)


def amplitude_deviations(
    sequence: MeshSequence,
    uncertainty: Uncertainty,
    template: Template,
    basis: Basis,
    rotations: Floats,
    reference: Reference,
    *,
    directions: Floats | None = None,
    along_normal: bool = False,
    remove_rotation: bool = True,
) -> Floats:
    """Propagate errors of positions to amplitudes.

    Parameters
    ----------
    sequence : MeshSequence
    uncertainty : Uncertainty
        Of its positions.
    template : Template
        Taken as exact.
    basis : Basis
        The modes that were fitted.
    rotations : (frames, 3, 3) float64
        Removed before the fit.
    reference : int or "mean"
        What displacements are measured from, whose own errors count too.
    directions : (vertices, n, 3) float64, optional
        Local directions of the components; x, y, z by default. Of normal displacements the lines.
    along_normal : bool
    remove_rotation : bool

    Returns
    -------
    (frames, modes, n) float64, length unit
        Zero in the reference frame.
    """
    covariances = uncertainty.across if along_normal else uncertainty.along
    own = np.empty(
        (sequence.n_frames, len(basis.modes), 3 if directions is None else directions.shape[1])
    )
    # Squares of lengths in any unit neither overflow nor vanish.
    unit = power_of_two(float(np.abs(sequence.vertices).max(initial=0.0)))
    rest, parts = uncertainty.rest / unit, None
    for f, R in enumerate(rotations):
        if parts is None or along_normal:
            turned = sequence.vertices[f] @ R
            x = turned if along_normal else alignment.reference_positions(sequence, reference)
            x = x / unit
            q = _answers(x, template, directions, along_normal=along_normal)
            moves, sizes = _rigid(
                x, template, q, along_normal=along_normal, remove_rotation=remove_rotation
            )
            parts = _parts(basis.projector, q, moves, sizes, uncertainty)
        variances = parts[0] * rest[f] ** 2
        if len(parts[1][0, 0]):
            L = (parts[1] @ R.T).reshape(variances.size, -1) / unit
            variances += ((L @ covariances[f]) * L).sum(axis=1).reshape(variances.shape)
        own[f] = np.sqrt(np.maximum(variances, 0.0))
    return unit * _from_reference(own, uncertainty.between_frames, reference)


def turns_of_axes(placement: Placement, uncertainty: Uncertainty, rotations: Floats) -> Floats:
    """Independent turns of a template's axes that make up their errors.

    Parameters
    ----------
    placement : Placement
    uncertainty : Uncertainty
        Of the positions of the sequence that it is the template of.
    rotations : (frames, 3, 3) float64
        That carry the reference onto each frame.

    Returns
    -------
    (n, 3) float64, rad
        Rotation vectors, one standard deviation each, n <= 3: their outer products add up to the
        covariance. An angle that is not known has the standard deviation of all angles.
    """
    slopes, n_frames = placement.slopes(), len(rotations)
    # Of the mean of all frames' errors.
    share = float(over_time(uncertainty.between_frames, n_frames).mean())
    apart = (slopes * uncertainty.alike[:, None]).reshape(3, -1) @ slopes.reshape(3, -1).T
    covariance = apart * float((uncertainty.rest**2).mean())
    if uncertainty.shapes.shape[1]:
        L = np.stack([slopes[:, :, c] @ uncertainty.shapes for c in range(3)], axis=2)
        for R, of_frame in zip(rotations, uncertainty.along, strict=True):
            rows = (L @ R.T).reshape(3, -1)
            covariance += rows @ of_frame @ rows.T / n_frames
    variances, columns = np.linalg.eigh(share * covariance)
    sizes = np.minimum(np.sqrt(np.maximum(variances, 0.0)), _UNKNOWN)
    return np.asarray((columns * sizes).T[sizes > 0])


def _answers(
    x: Floats, template: Template, directions: Floats | None, *, along_normal: bool
) -> Floats:
    """Find what each component of each vertex answers to, (vertices, n, 3)."""
    if directions is None:
        return np.broadcast_to(np.eye(3), (len(x), 3, 3))
    if not along_normal:
        return directions
    normals = geometry.vertex_normals(x, template.faces)[template.representatives]
    line = directions[:, 0]
    cosines = (normals * line).sum(axis=1)
    # Which way triangles are wound is no matter.
    steep = np.abs(cosines) < _STEEP
    answers: Floats = normals / np.where(steep, 1.0, cosines)[:, None]
    answers[steep] = line[steep]
    return answers[:, None]


def _rigid(
    x: Floats, template: Template, q: Floats, *, along_normal: bool, remove_rotation: bool
) -> tuple[Floats, Floats]:
    """Find the rigid motions that the fit takes out of errors of a frame's positions.

    Returns
    -------
    moves : (vertices, 3, k) float64
        Displacement of each vertex by each.
    sizes : (k, vertices, 3) float64
        How much of each is in an error of each vertex.
    """
    w = template.weights
    if not along_normal:
        if not remove_rotation:
            return np.zeros((len(x), 3, 0)), np.zeros((0, len(x), 3))
        r = x - w @ x
        turns = np.stack([np.cross(axis, r) for axis in np.eye(3)], axis=2)
        inertia = np.einsum("v,vik,vil->kl", w, turns, turns)
        sizes = (
            np.linalg.pinv(inertia, hermitian=True) @ (turns * w[:, None, None]).reshape(-1, 3).T
        )
        return turns, sizes.reshape(3, len(x), 3)
    areas = mesh.vertex_areas(x, template.faces)
    centroid = areas @ x / (float(areas.sum()) or 1.0)
    drift = mesh.mean_slopes(x, template.faces, (x - centroid).T, np.eye(3)[:, None])
    shifts = np.broadcast_to(np.eye(3), (len(x), 3, 3))
    if not remove_rotation:
        return shifts, drift
    r = x - centroid
    along = q[:, 0]
    slopes = np.cross(r, along)
    weighted = slopes * w[:, None]
    pull = _PULL * float(w @ (r**2).sum(axis=1))
    A = weighted.T @ slopes + pull * np.eye(3)
    # Normal displacements, the drift taken out, lead to the turn.
    heights = weighted.T[:, :, None] * along
    heights -= np.tensordot(weighted.T @ along, drift, axes=1)
    turn = np.linalg.solve(A, heights.reshape(3, -1)).reshape(3, len(x), 3)
    turns = np.stack([np.cross(axis, r) for axis in np.eye(3)], axis=2)
    return np.concatenate([shifts, turns], axis=2), np.concatenate([drift, turn])


def _parts(
    P: Floats, q: Floats, moves: Floats, of_errors: Floats, uncertainty: Uncertainty
) -> tuple[Floats, Floats]:
    """Find variances of amplitudes by errors apart of variance 1, (modes, n).

    And amplitudes by the errors in modes, (modes, n, shapes, 3).
    """
    n_modes, n_vertices = P.shape
    n, k, m = q.shape[1], len(of_errors), uncertainty.shapes.shape[1]
    # How much each rigid motion adds to each amplitude.
    answers = np.einsum("vic,vck->vik", q, moves).reshape(n_vertices, n * k)
    of_rigid = (P @ answers).reshape(n_modes, n, k)
    # Errors apart: each vertex counts with its own, and with those that are the same.
    squares = (P**2) @ (uncertainty.alike[:, None] * (q**2).sum(axis=2))
    spread = of_errors * uncertainty.alike[:, None]
    mixed = np.einsum("vic,kvc->vik", q, spread).reshape(n_vertices, n * k)
    mixed = (P @ mixed).reshape(n_modes, n, k)
    gram = np.einsum("kvc,lvc->kl", spread, of_errors)
    variances = squares - 2.0 * (mixed * of_rigid).sum(axis=2)
    variances += np.einsum("jik,kl,jil->ji", of_rigid, gram, of_rigid)
    L = np.empty((n_modes, n, m, 3))
    if m:
        sizes = np.empty((k, m, 3))
        for c in range(3):
            for i in range(n):
                L[:, i, :, c] = (P * q[:, i, c]) @ uncertainty.shapes
            sizes[:, :, c] = of_errors[:, :, c] @ uncertainty.shapes
        L -= np.tensordot(of_rigid, sizes, axes=1)
    return variances, L


def _from_reference(own: Floats, between_frames: float, reference: Reference) -> Floats:
    """Deviations of differences from the reference, whose errors are correlated with a frame's.

    var(e - e') = s^2 - 2 c s s' + s'^2; of the mean shape with all frames' errors in it.
    """
    correlations = over_time(between_frames, len(own))
    if reference == MEAN:
        mixed = own * np.tensordot(correlations, own, axes=1) / len(own)
        variances = own**2 - 2.0 * mixed + mixed.mean(axis=0)
    else:
        c = correlations[:, reference][:, None, None]
        variances = own**2 - 2.0 * c * own * own[reference] + own[reference] ** 2
    return np.asarray(np.sqrt(np.maximum(variances, 0.0)))


def deviations_of(fitter: Fitter, fit: Fit, noise: Noise | None) -> tuple[Floats, list[Note]]:
    """Propagate what is known of the positions' errors to the amplitudes.

    Parameters
    ----------
    fitter : Fitter
    fit : Fit
    noise : Noise or None
        If it was estimated; without it, and without a track, it is.

    Returns
    -------
    deviations : (frames, modes, n) float64, length unit
    notes : list of Note
        What they come from.
    """
    sequence, template, parameters = fitter.sequence, fitter.template, fitter.parameters
    uncertainty, notes, words = sequence.uncertainty, list[Note](), "the deviations of the track"
    if uncertainty is None:
        words = "the noise of the vertices"
        if noise is None:
            # Of displacements, whose noise is known.
            noise = estimated(replace(fitter, normal_displacements=None)).noise
            notes = [noise.note(sequence.unit)]
        # Of vertices that count alike: by how much they count is in the fit.
        n = sequence.n_vertices
        independent = noise.independent_vertices * n * float((template.weights**2).sum())
        uncertainty = Uncertainty.of_noise(
            noise.sigma, sequence.n_frames, n, independent, noise.between_frames
        )
    matrices = fit.rotations.matrices
    deviations = amplitude_deviations(
        sequence,
        uncertainty,
        template,
        fit.basis,
        matrices,
        parameters.reference,
        directions=fitter.frames,
        along_normal=fitter.normal_displacements is not None,
        remove_rotation=parameters.remove_rotation,
    )
    placement = template.placement
    if placement is not None and parameters.template is None:
        # Of the sequence itself: where its axes point is part of the error.
        variances = deviations**2
        own = fitter.along(fit.basis.projector)
        for turn in turns_of_axes(placement, uncertainty, matrices):
            turned = replace(fitter, template=template.turned(turn))
            # So many modes that the turned shape just cannot distinguish them: none is about axes.
            with suppress(errors.ModeCountError):
                basis = make_basis(turned.template, fit.basis.modes)
                variances += (turned.along(basis.projector) - own) ** 2
        deviations = np.sqrt(variances)
        words += ", and from how far they leave axis and zero of theta undecided"
    return deviations, [*notes, Note.of("deviations_from", source=words)]
