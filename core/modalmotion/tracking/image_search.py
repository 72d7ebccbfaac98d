"""A surface drawn to the edges of one image: coarse to fine, with levels and shifts of slices."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from modalmotion.errors import ShapeError
from modalmotion.images import PlaneSet
from modalmotion.images.sequence import Image
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.numeric.scales import gram, inverse_of_cholesky
from modalmotion.representation import Floats
from modalmotion.template import make_template
from modalmotion.tracking.deformable import Deformable, require_unfolded
from modalmotion.tracking.image_levels import renewed
from modalmotion.tracking.image_view import Facets, Imaging, View, view_of
from modalmotion.tracking.map_frames import FrameEstimate, evidence, first_guess, map_frame
from modalmotion.tracking.noise import Noise, Prior
from modalmotion.tracking.normal_equations import NormalEquations, normal_equations
from modalmotion.tracking.observation import Frame, Observation

# mm: prior deviation of a slice's shift along each of its axes, before the shifts themselves say.
_LEAST_SHIFT: Final = 0.3
_MOST_SHIFT: Final = 4.0


class Scene(NamedTuple):
    """What an iteration in one image is about.

    Parameters
    ----------
    surface : Deformable
    frame : Frame
        What the view observed first, then landmarks.
    view : View
    amplitudes : (modes, 3) float64, mm
    prior : Prior
    noise : Noise
    imaging : Imaging
    """

    surface: Deformable
    frame: Frame
    view: View
    amplitudes: Floats
    prior: Prior
    noise: Noise
    imaging: Imaging


class _Joint(NamedTuple):
    """Equations of the shape and of all shifts: (H, C; C', D) and what pulls at the shifts."""

    info: NormalEquations
    H: Floats
    C: Floats
    D: Floats
    pull: Floats


def with_shifts(scene: Scene) -> tuple[FrameEstimate, Imaging]:
    """Amplitudes and shifts of all planes in one step, for either could explain the other's part.

    Notes
    -----
    min sum s (n . (r - dt) - (phi n) . da)^2 + a' K a + t^2 / tau^2 over da and dt, where r is the
    way from the surface to an edge and n the surface's normal, for dt its part in the plane.
    """
    joint, imaging = _joint(scene), scene.imaging
    n, now = 3 * len(scene.surface), scene.amplitudes.ravel()
    b = joint.info.vector - (joint.H @ now[:, None])[:, 0]
    inverse = inverse_of_cholesky(np.block([[joint.H, joint.C], [joint.C.T, joint.D]]))
    right = np.append(b, joint.pull)[:, None]
    step = (inverse.T @ (inverse @ right))[:, 0]
    covariance = gram(inverse)
    own = np.ascontiguousarray(covariance[:n, :n])
    estimate = FrameEstimate((now + step[:n]).reshape(-1, 3), joint.info, own)
    shifts = imaging.shifts + step[n:].reshape(-1, 3)
    # What the images have set of them, of both axes of each plane; the third stays the prior's.
    set_by = shifts.size - np.diag(covariance)[n:].sum() / imaging.shift_sd**2
    sd = float(np.sqrt((shifts**2).sum() / max(set_by, 1e-3 * len(shifts))))
    sd = float(np.clip(sd, _LEAST_SHIFT, _MOST_SHIFT))
    return estimate, replace(imaging, shifts=shifts, shift_sd=sd)


def left_by_shifts(scene: Scene, normals: Floats) -> Floats:
    """Deviation across the surface that shifts leave, (vertices,) mm.

    Parameters
    ----------
    scene : Scene
        Where the iterations have come to rest.
    normals : (vertices, 3) float64

    Notes
    -----
    An estimate of the shape that takes the shifts found for true moves by -H^-1 C dt where they
    are wrong by dt, and no residual shows it. S, the covariance of dt whatever the shape is, is
    the block of the inverse of (H, C; C', D), that is (D - C' H^-1 C)^-1, so that the shape has
    H^-1 C S C' H^-1 more than the covariance H^-1 that it has for known shifts.
    """
    joint = _joint(scene)
    inverse = inverse_of_cholesky(joint.H)
    half = inverse @ joint.C
    S = gram(inverse_of_cholesky(joint.D - (half.T @ half)))
    moved = inverse.T @ half
    rows = (scene.surface.shapes[:, :, None] * normals[:, None, :]).reshape(len(normals), -1)
    seen = rows @ moved
    deviations: Floats = np.sqrt(np.maximum(((seen @ S) * seen).sum(axis=1), 0.0))
    return deviations


def _joint(scene: Scene) -> _Joint:
    surface, frame, view, a, prior, noise, imaging = scene
    info = normal_equations(surface, a, frame, noise)
    rows = frame[0]
    counted = info.weights * (1.0 if rows.weights is None else rows.weights)
    strength = counted / noise.variances(rows.sd, float(counted.sum()))
    k = view.edges.is_found
    n, e = view.normals[k], view.directions[k]
    # Only along e a profile shows a shift in its plane; across it is the curve itself.
    flat = (n * e).sum(axis=1, keepdims=True) * e
    phi = (view.shares[k][:, :, None] * surface.shapes[view.feet[k]]).sum(axis=1)
    of_shape = (phi[:, :, None] * n[:, None, :]).reshape(len(n), -1)
    of_shifts = np.zeros((len(n), *imaging.shifts.shape))
    of_shifts[np.arange(len(n)), view.planes[k]] = flat
    of_shifts = of_shifts.reshape(len(n), -1)
    weighted = np.ascontiguousarray((strength[:, None] * of_shifts).T)
    C = np.ascontiguousarray((weighted @ of_shape).T)
    D = (weighted @ of_shifts) + np.eye(imaging.shifts.size) / imaging.shift_sd**2
    pull = (
        weighted @ (info.residuals * n).sum(axis=1) - imaging.shifts.ravel() / imaging.shift_sd**2
    )
    stiffness = surface.stiffness(prior.variances(surface.wavenumbers))
    return _Joint(info, info.matrix + stiffness, C, D, pull)


# Steps of one stage, and RMS of the last one, mm.
_MOST_STEPS: Final = 8
_SMALL: Final = 0.1


def search(
    surface: Deformable,
    facets: Facets,
    image: Image,
    marks: Frame,
    start: Floats,
    prior: Prior,
    noise: Noise,
    imaging: Imaging,
    reach: float,
    *,
    is_known: bool,
) -> Scene:
    """Draw a surface to the edges within `reach` mm, sampling the image anew at each step.

    Parameters
    ----------
    surface : Deformable
    facets : Facets
    image : Volume or PlaneSet
    marks : Frame
        Landmarks of this frame.
    start : (modes, 3) float64, mm
    prior : Prior
    noise : Noise
    imaging : Imaging
    reach : float, mm
    is_known : bool
        Whether levels, bias field, shifts of slices, prior and noise are known, or estimated with
        the shape.

    Returns
    -------
    Scene
        Its view is about the shape before the last step.
    """
    a = start
    view = view_of(image, facets, surface.positions(a), imaging, reach)
    for step in range(_MOST_STEPS):
        frame: Frame = (view.observation(), *marks)
        variances = prior.variances(surface.wavenumbers)
        if not is_known and isinstance(image, PlaneSet):
            own, imaging = with_shifts(Scene(surface, frame, view, a, prior, noise, imaging))
        else:
            own = map_frame(surface, frame, a, variances, noise, most_steps=2)
        change = float(np.linalg.norm(own.amplitudes - a))
        a = own.amplitudes
        if not is_known and step:
            prior, noise, _ = evidence(surface, [own], prior)
            imaging = renewed(imaging, view)
        if change < _SMALL:
            break
        view = view_of(image, facets, surface.positions(a), imaging, reach)
    return Scene(surface, (view.observation(), *marks), view, a, prior, noise, imaging)


# Modes and reach, mm: of a start from landmarks, and of the shape that is taken.
_COLD: Final = ((7, 18.0), (18, 10.0), (37, 5.0))
SHAPE: Final = (61, 4.0)

# Least share of profiles with an edge. In noise alone it is about a tenth.
LEAST_FOUND: Final = 0.25


class ReferenceShape(NamedTuple):
    """Shape of the reference frame, and how its images are read.

    Parameters
    ----------
    shape : MeshSequence
        One frame, mm.
    imaging : Imaging
    found : float
        Share of the profiles with an edge.
    bent : (vertices,) float64, mm
        Deviation across the surface that shifts of slices leave; zero where there are none.
    """

    shape: MeshSequence
    imaging: Imaging
    found: float
    bent: Floats


def reference_shape(
    rough: MeshSequence, image: Image, marks: Frame, imaging: Imaging, number: int, points: Floats
) -> ReferenceShape:
    """Search for it coarse to fine, with levels, bias field and shifts of slices.

    Parameters
    ----------
    rough : MeshSequence
        What the search begins on.
    image : Volume or PlaneSet
    marks : Frame
        Landmarks of this frame.
    imaging : Imaging
    number : int
        Of the frame.
    points : (n, 3) float64, mm
        Where rays from the axis first met an edge.

    Raises
    ------
    ShapeError
        Where hardly any profile shows an edge.
    """
    base = make_template(rough)
    facets = Facets.of(base.faces, base.vertices, base.weights)
    surface, a, found = Deformable.of(base, 1), np.zeros((1, 3)), 0.0
    bent = np.zeros(base.n_vertices)
    for modes, reach in (*_COLD, SHAPE):
        surface = Deformable.of(base, modes)
        prior, noise = first_guess(surface)
        is_cold = len(a) == 1
        a = np.concatenate([a, np.zeros((len(surface) - len(a), 3))])
        if is_cold:
            # Wherever a start is, and however wide it is, rays from the axis met the edge there.
            variances = prior.variances(surface.wavenumbers)
            a = map_frame(surface, (Observation(points), *marks), a, variances, noise).amplitudes
        state = search(
            surface,
            facets,
            image,
            marks,
            a,
            prior,
            noise,
            imaging.within(reach),
            reach,
            is_known=is_cold,
        )
        a, imaging, found = state.amplitudes, state.imaging, state.view.found
    if found < LEAST_FOUND:
        raise ShapeError(
            f"No object is seen in frame {number}: on {found:.0%} of the profiles across the "
            "surface there is an edge, and noise alone shows one on a tenth.",
            remedy="Check apex and base, and that the images show an inside and an outside.",
            frame=number,
            details={"found": found},
        )
    x = surface.positions(a)
    require_unfolded(surface, x[None])
    fitted = mesh_sequence(x[None], rough.faces, grid=rough.grid, topology=rough.topology)
    if isinstance(image, PlaneSet):
        bent = left_by_shifts(state, facets.normals(x))
    return ReferenceShape(fitted, imaging, found, bent)
