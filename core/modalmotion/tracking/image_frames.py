"""Images become observations: edges in every frame, found from the reference on.

Beyond the base the wall of an atrium goes on, which is none of the surface's.

A track of these edges then gets what images add: convention, slices, and errors in common. The
surface is that of the compact wall, papillary muscles within the pool: edges nearer to the axis are
crossed where blood is beyond them, and are strays where none does. Muscle keeps its volume over the
beat. So one number turns volumes of the convention `pool` into those of the convention `wall`, in
which muscles do not count as cavity.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np

from modalmotion import errors, mesh
from modalmotion.images import ImageSequence, PlaneSet
from modalmotion.images.volume import Image
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CUP
from modalmotion.notes import Note
from modalmotion.numeric.scales import gram, inverse_of_cholesky
from modalmotion.representation import Floats
from modalmotion.template import Template, make_template
from modalmotion.tracking import first_shape, map_frames, moving_base, result
from modalmotion.tracking.deformable import Deformable, require_unfolded
from modalmotion.tracking.image_view import (
    FAINT,
    Facets,
    Imaging,
    View,
    as_bright,
    first_sight,
    renewed,
    view_of,
)
from modalmotion.tracking.landmarks import Proposed, with_landmarks
from modalmotion.tracking.noise import Noise, Prior
from modalmotion.tracking.normal_equations import NormalEquations, normal_equations
from modalmotion.tracking.observation import Frame, Observation, ends_in
from modalmotion.tracking.trabecular_correction import has_trabeculae, with_trabeculae

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


def with_shifts(scene: Scene) -> tuple[map_frames.FrameEstimate, Imaging]:
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
    estimate = map_frames.FrameEstimate((now + step[:n]).reshape(-1, 3), joint.info, own)
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
    a, imaging = start, imaging.within(reach)
    prior, noise = map_frames.first_guess(surface)
    view = view_of(image, facets, surface.positions(a), imaging, reach)
    for step in range(_MOST_STEPS):
        frame: Frame = (view.observation(), *marks)
        variances = prior.variances(surface.wavenumbers)
        if not is_known and isinstance(image, PlaneSet):
            own, imaging = with_shifts(Scene(surface, frame, view, a, prior, noise, imaging))
        else:
            own = map_frames.map_frame(surface, frame, a, variances, noise, most_steps=2)
        change = float(np.linalg.norm(own.amplitudes - a))
        a = own.amplitudes
        if not is_known and step:
            prior, noise = map_frames.shape_evidence(surface, own, prior)
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
        is_cold = len(a) == 1
        a = np.concatenate([a, np.zeros((len(surface) - len(a), 3))])
        if is_cold:
            # Wherever a start is, and however wide it is, rays from the axis met the edge there.
            prior, noise = map_frames.first_guess(surface)
            variances, frame = prior.variances(surface.wavenumbers), (Observation(points), *marks)
            a = map_frames.map_frame(surface, frame, a, variances, noise).amplitudes
        state = search(surface, facets, image, marks, a, imaging, reach, is_known=is_cold)
        a, imaging, found = state.amplitudes, state.imaging, state.view.found
    if found < LEAST_FOUND:
        raise errors.ShapeError(
            f"No object is seen in frame {number}: on {found:.0%} of the profiles across the "
            "surface there is an edge; noise alone gives one on a tenth.",
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


# Of the length of a ventricle: how far its base is towards the apex in frames other than the
# reference, before their volumes are known.
_DESCENT: Final = 0.1

# mm: deviation of the tip of a ventricle from its place in the reference, where no apex is stated.
_TIP: Final = 6.0

# mm beyond the base that an edge may be seen at: its rim is no plane across the axis.
_BEYOND: Final = 3.0


def with_end(
    stated: Sequence[Frame], reference: int, end: str, places: Floats, sd: float
) -> tuple[Frame, ...]:
    """Add the place of an end, (frames, 3) or (3,), to frames that do not state it."""
    each = np.broadcast_to(places, (len(stated), 3))
    return tuple(
        frame
        if k == reference or end in ends_in(frame)
        else (*frame, Observation(place[None], sd=sd, places=(end,)))
        for k, (frame, place) in enumerate(zip(stated, each, strict=True))
    )


def below_base(imaging: Imaging, marks: Frame, template: Template) -> Imaging:
    """Imaging of one frame, to which edges beyond the base do not count."""
    known = ends_in(marks).get("base")
    if template.surface != CUP or known is None:
        return imaging
    tip, base = moving_base.ends_of_cup(template)
    axis = (base - tip) / np.linalg.norm(base - tip)
    return replace(imaging, valve=(axis, float(known @ axis) + _BEYOND))


# Modes and reach, mm, of each next frame.
_NEXT: Final = ((18, 8.0), (37, 5.0))

# Of the finest voxel: deviation of a landmark that states none, that of a click on a voxel, which
# is anywhere within it. How noisy an edge is, as in speckle, says nothing of it.
_STATED: Final = 12.0**-0.5


@dataclass(frozen=True, eq=False)
class ImageFrames:
    """Observations that images came to.

    Parameters
    ----------
    frames : tuple of Frame
        Profiles without landmarks; empty if nothing was found.
    start : MeshSequence
        The reference frame's shape.
    facets : Facets
    imaging : Imaging
    found : (frames,) float64
        Share of the profiles with an edge.
    notes : tuple of Note
    stated_sd : float, mm
        Deviation of landmarks that state none.
    closed : (frames,) float64, mm
        Mean muscle of trabeculae that look like the wall, beyond the edges that are seen.
    bent : (vertices,) float64, mm
        Deviation across the surface that shifts of slices leave; zero where there are none.
    levels : mapping of str to (frames, frames) float64, mm^2
        Of proposed apex and base: covariance of errors along the axis.
    """

    frames: tuple[Frame, ...]
    start: MeshSequence
    facets: Facets
    imaging: Imaging
    found: Floats
    notes: tuple[Note, ...]
    stated_sd: float
    closed: Floats
    bent: Floats
    levels: Mapping[str, Floats]


def frames_of_images(
    images: ImageSequence,
    landmarks: Mapping[str, Any] | None,
    *,
    start: MeshSequence | Template | None,
    modes: int,
    reference: int,
    is_closed: bool,
    done: Callable[[], object],
) -> ImageFrames:
    """Find a surface's edges in all frames.

    Parameters
    ----------
    images : ImageSequence
    landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like, mm
    start : MeshSequence or Template, optional
    modes : int
    reference : int
        Frame that levels are taken from, and the search starts in.
    is_closed : bool
    done : callable
        Called after each frame.

    Raises
    ------
    InputError
        Where nothing can be found in the reference frame.
    """
    images = images.sliced()
    stated_sd = _STATED * images.finest
    empty: tuple[Frame, ...] = ((),) * images.n_frames
    stated = with_landmarks(empty, landmarks, reference, stated_sd)
    places = ends_in(stated[reference])
    image = images.frames[reference]
    if image is None:
        raise errors.ShapeError(
            f"Frame {reference}, from which the shape is taken, is missing.",
            remedy="Name a reference frame that exists.",
            frame=reference,
        )
    if not {"apex", "base"} <= set(places):
        raise errors.ParameterError(
            "Images show edges, but not which of them bound the surface: the landmarks apex and "
            f"base are missing in the reference frame {reference}.",
            remedy="Give apex=x,y,z and base=x,y,z (the middle of the opening) in LPS mm, or a "
            "file of them, as written by the service's page and by 3D Slicer (.mrk.json).",
            frame=reference,
            details={"needed": ["apex", "base"]},
        )
    levels, points = first_sight(image, places["apex"], places["base"], reference)
    n_planes = len(image) if isinstance(image, PlaneSet) else 1
    middle = (places["apex"] + places["base"]) / 2.0
    imaging = Imaging(levels, np.zeros(3), middle, np.zeros((n_planes, 3)))
    if start is None:
        rough = first_shape.start_shape(CUP, points, places)
    elif isinstance(start, Template):
        rough = mesh_sequence(start.vertices[None], start.faces, topology=start.topology)
    else:
        rough = start
    here = stated[reference]
    begin = reference_shape(rough, image, here, imaging, reference, points)
    if has_trabeculae(image, begin.shape, begin.imaging, SHAPE[1]):
        imaging = replace(imaging, layers=FAINT)
        begin = reference_shape(rough, image, here, imaging, reference, points)
    shape, imaging = begin.shape, begin.imaging
    done()
    template = make_template(shape)
    surface = Deformable.of(template, modes)
    facets = Facets.of(template.faces, template.vertices, template.weights)
    tips = marks = stated
    if is_cup := template.surface == CUP:
        tip, base = moving_base.ends_of_cup(template)
        tips = with_end(stated, reference, "apex", tip, _TIP)
        marks = with_end(tips, reference, "base", base + _DESCENT * (tip - base), moving_base.HELD)
    shapes = np.repeat(template.vertices[None], images.n_frames, axis=0)
    for path in map_frames.paths_from(reference, images.n_frames, is_closed=is_closed)[1:]:
        a = np.zeros((len(surface), 3))
        for k in path:
            own = images.frames[k]
            if own is not None:
                look = below_base(imaging, marks[k], template)
                a = _next(surface, facets, own, marks[k], a, look)
            shapes[k] = surface.positions(a)
            done()
    if is_cup and marks != tips:
        by_volume, _ = moving_base.base_by_volume(stated, template, reference, shapes)
        marks = with_end(tips, reference, "base", by_volume, moving_base.HELD)
    near = _NEXT[-1][1]
    views: list[View | None] = []
    looks: list[Imaging] = []
    for k, (own, x) in enumerate(zip(images.frames, shapes, strict=True)):
        look = imaging if k == reference else below_base(imaging, marks[k], template)
        look = look.within(near)
        view = None if own is None else view_of(own, facets, x, look, near)
        if own is not None and view is not None and k != reference:
            look = as_bright(look, view)
            view = view_of(own, facets, x, look, near)
        views.append(view)
        looks.append(look)
        done()
    shares = np.array([0.0 if view is None else view.found for view in views])
    closed = np.zeros(len(views))
    if imaging.has_layers:
        views, closed = with_trabeculae(views, looks, surface, shapes, reference)
    frames: list[Frame] = []
    for view, share, known, marked in zip(views, shares, stated, tips, strict=True):
        is_seen = view is not None and share >= LEAST_FOUND
        held = marked[len(known) :]
        frames.append((view.observation(), *held) if view is not None and is_seen else ())
    lost = [k for k, view in enumerate(views) if view is not None and not frames[k]]
    notes = images.notes
    if lost:
        first_lost, share = lost[0], begin.found
        notes += (
            Note.of("frames_without_edges", n_frames=len(lost), first=first_lost, share=share),
        )
    return ImageFrames(
        tuple(frames),
        shape,
        facets,
        imaging,
        shares,
        notes,
        stated_sd,
        closed,
        begin.bent,
        {
            name: own.covariance
            for name, own in (landmarks or {}).items()
            if isinstance(own, Proposed) and own.covariance is not None
        },
    )


def _next(
    surface: Deformable, facets: Facets, image: Image, marks: Frame, a: Floats, imaging: Imaging
) -> Floats:
    """Amplitudes of a frame, from those of its neighbour on."""
    for modes, reach in _NEXT:
        coarse = surface if modes >= len(surface) else Deformable.of(surface.template, modes)
        m = len(coarse)
        # What finer modes have reached stays where it is.
        rest = surface.positions(np.concatenate([np.zeros((m, 3)), a[m:]]))
        moved = replace(coarse, template=replace(coarse.template, vertices=rest))
        own = search(moved, facets, image, marks, a[:m], imaging, reach, is_known=True)
        a = np.concatenate([own.amplitudes, a[m:]])
    return a


# Of a voxel, and of the noise of one edge (speckle is alike at neighbours): how far all edges may
# be off alike, which no residual shows.
_OF_VOXEL: Final = 0.08
_OF_NOISE: Final = 0.4

# Of muscle that is beyond the edges seen: how much of its depth at one place, and how much of all
# of it is not known.
_OF_CLOSED: Final = 0.5
_OF_ALL_CLOSED: Final = 0.3

# Places on lines from the middle to the surface, as shares.
_SHARES: Final = (np.arange(20) + 0.5) / 20.0

# Of a voxel's longer side in the image: nearer to the surface its own edge is seen.
_SHELL: Final = 1.4


def with_images(
    track: result.Track, images: ImageSequence, found: ImageFrames, papillary: result.Papillary
) -> result.Track:
    """Add to a track of edges what its images were like.

    Parameters
    ----------
    track : Track
        Of the observations in `found`.
    images : ImageSequence
    found : ImageFrames
    papillary : {"pool", "wall"}

    Returns
    -------
    Track
        Its deviations with those that residuals do not show: of a bias that all edges of all frames
        have in common, and of bent stacks of slices.
    """
    images, imaging = images.sliced(), found.imaging
    shapes = track.sequence.vertices.astype(np.float64)
    first = next(frame for frame in images.frames if frame is not None)
    is_sliced = isinstance(first, PlaneSet)
    if isinstance(first, PlaneSet):
        voxel = max(max(plane.spacing) for plane in first.planes)
    else:
        voxel = max(first.spacing)
    areas = np.array([mesh.face_areas(x, track.template.faces).sum() for x in shapes])
    # Steps of a label map are noise of its edges, which residuals show.
    localisation = 0.0
    if not imaging.levels.is_labelled:
        localisation = float(np.hypot(_OF_VOXEL * voxel, _OF_NOISE * track.noise.sd))
    volumes = np.zeros(len(shapes)) if track.volumes is None else track.volumes
    # Within the surface, of what looks like the outside.
    muscles = [
        _share(image, x, found.facets, imaging) * volume
        for image, x, volume in zip(images.frames, shapes, volumes, strict=True)
        if image is not None
    ]
    answer = result.ImageAnswer(
        papillary,
        max(float(np.median(muscles)), 0.0),
        imaging.levels.inside,
        imaging.levels.outside,
        imaging.levels.spread,
        tuple(imaging.slope.tolist()),
        tuple(tuple(row) for row in imaging.shifts.tolist()) if is_sliced else (),
        imaging.shift_sd if is_sliced else 0.0,
        tuple(found.found.tolist()),
        localisation,
        float(np.sqrt(np.average(found.bent**2, weights=track.template.weights))),
    )
    at_places = _OF_CLOSED * found.closed[:, None]
    deviations = np.array(track.deviations)
    deviations[..., 0] = np.sqrt(
        deviations[..., 0] ** 2 + answer.localisation**2 + found.bent**2 + at_places**2
    )
    volume_deviations, correlation = track.volume_deviations, 0.0
    if volume_deviations is not None:
        closed = _OF_ALL_CLOSED * found.closed
        volume_deviations = np.hypot(volume_deviations, np.hypot(localisation, closed) * areas)
        both = [volumes.argmax(), volumes.argmin()]
        stated = float(volume_deviations[both].prod())
        correlation = float((localisation * areas[both]).prod()) / stated if stated > 0 else 0.0
    return replace(
        track,
        deviations=deviations,
        volume_deviations=volume_deviations,
        volume_correlation=correlation,
        images=answer,
    )


def _side(image: Image) -> float:
    if isinstance(image, PlaneSet):
        return max(max(plane.spacing) for plane in image.planes)
    return float(np.median(image.spacing))


def _share(image: Image, x: Floats, facets: Facets, imaging: Imaging) -> float:
    """Share of the cavity, weighted by volume, that is like the outside."""
    corners = x[facets.faces]
    middle = x.mean(axis=0)
    centres = corners.mean(axis=1) - middle
    # Cones from the middle: dV = 3 V t^2 dt.
    cones = np.abs((np.cross(corners[:, 1] - middle, corners[:, 2] - middle) * centres).sum(axis=1))
    points = (middle + _SHARES[:, None, None] * centres).reshape(-1, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    heights = (normals * centres).sum(axis=1) / np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    depths = np.outer(1.0 - _SHARES, np.abs(heights))
    weights = (_SHARES[:, None] ** 2 * cones).ravel()
    is_deep = (depths > _SHELL * _side(image)).ravel()
    if isinstance(image, PlaneSet):
        near = [np.abs(plane.heights(points)) < plane.thickness / 2 for plane in image.planes]
        views = zip(image.planes, near, imaging.shifts, strict=True)
        values = np.concatenate([p.sample(points[own] + shift) for p, own, shift in views])
        rows = np.concatenate([np.flatnonzero(own) for own in near])
        points, weights, is_deep = points[rows], weights[rows], is_deep[rows]
    else:
        values = image.sample(points)
    there = np.isfinite(values)
    dark = (1.0 - imaging.levels.likeness(values[there], imaging.gain(points[there]))) / 2.0
    # What noise does to blood on either side cancels in the mean.
    muscle = (weights[there] * is_deep[there] * np.clip(dark, -0.5, 1.5)).sum()
    total = float(weights[there].sum())
    return float(muscle) / total if total > 0 else 0.0
