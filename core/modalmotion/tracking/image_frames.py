"""Images become observations: edges in every frame, found from the reference on.

Beyond the base the wall of an atrium goes on, which is none of the surface's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.images import ImageSequence, PlaneSet
from modalmotion.images.sequence import Image
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import CUP
from modalmotion.template import Template, make_template
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.first_shape import start_shape
from modalmotion.tracking.image_levels import as_bright, first_sight
from modalmotion.tracking.image_search import LEAST_FOUND, SHAPE, reference_shape, search
from modalmotion.tracking.image_view import Facets, Sight, View, view_of
from modalmotion.tracking.iterations import first_guess, paths_from
from modalmotion.tracking.landmarks import Proposed, with_landmarks
from modalmotion.tracking.moving_base import HELD, base_by_volume, ends_of_cup
from modalmotion.tracking.observation import Frame, Observation, ends_in
from modalmotion.tracking.result import CONVENTIONS, Papillary
from modalmotion.tracking.trabecular_correction import has_trabeculae, with_trabeculae

Floats = NDArray[np.float64]

# Of the length of a ventricle: how far its base is towards the apex in frames other than the
# reference, before their volumes are known.
_DESCENT: Final = 0.1

# mm beyond the base that an edge may be seen at: its rim is no plane across the axis.
_BEYOND: Final = 3.0


def with_base(
    stated: Sequence[Frame], template: Template, reference: int, places: Floats
) -> tuple[Frame, ...]:
    """Hold the base of a cup at places, (frames, 3) or (3,), in frames that state none."""
    each = np.broadcast_to(places, (len(stated), 3))
    return tuple(
        frame
        if template.surface != CUP or k == reference or "base" in ends_in(frame)
        else (*frame, Observation(place[None], sd=HELD, places=("base",)))
        for k, (frame, place) in enumerate(zip(stated, each, strict=True))
    )


def below_base(sight: Sight, marks: Frame, template: Template) -> Sight:
    """Sight of one frame, to which edges beyond the base do not count."""
    known = ends_in(marks).get("base")
    if template.surface != CUP or known is None:
        return sight
    tip, base = ends_of_cup(template)
    axis = (base - tip) / np.linalg.norm(base - tip)
    return replace(sight, valve=(axis, float(known @ axis) + _BEYOND))


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
    papillary : {"pool", "wall"}
    sight : Sight
    found : (frames,) float64
        Share of the profiles with an edge.
    notes : tuple of str
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
    papillary: Papillary
    sight: Sight
    found: Floats
    notes: tuple[str, ...]
    stated_sd: float
    closed: Floats
    bent: Floats
    levels: Mapping[str, Floats]


def frames_of_images(
    images: ImageSequence,
    landmarks: Mapping[str, Any] | None,
    *,
    papillary: Papillary,
    start: MeshSequence | Template | None,
    modes: int,
    reference: int,
    is_closed: bool,
    done: Callable[[], None],
) -> ImageFrames:
    """Find a surface's edges in all frames.

    Parameters
    ----------
    images : ImageSequence
    landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like, mm
    papillary : {"pool", "wall"}
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
    if papillary not in CONVENTIONS:
        raise ParameterError(
            f"The convention about papillary muscles is {papillary!r:.40}.",
            remedy="Use pool, where they are cavity, or wall, where they are not.",
        )
    images = images.sliced()
    stated_sd = _STATED * images.finest
    stated = _marks(images, landmarks, reference, stated_sd)
    places = ends_in(stated[reference])
    image = images.frames[reference]
    if image is None:
        raise ShapeError(
            f"Frame {reference}, which the shape is taken from, is missing.",
            remedy="Name a reference frame that is there.",
            frame=reference,
        )
    if not {"apex", "base"} <= set(places):
        raise ParameterError(
            "Images show edges, but not which of them bound the surface: the landmarks apex and "
            f"base are missing in the reference frame {reference}.",
            remedy="Give apex=x,y,z and base=x,y,z (the middle of the opening) in LPS mm, or a "
            "file of them, as the page of the service and 3D Slicer write it (.mrk.json).",
            frame=reference,
            details={"needed": ["apex", "base"]},
        )
    first = first_sight(image, places["apex"], places["base"], reference)
    n_planes = len(image) if isinstance(image, PlaneSet) else 1
    middle = (places["apex"] + places["base"]) / 2.0
    sight = Sight(first.levels, np.zeros(3), middle, np.zeros((n_planes, 3)))
    if start is None:
        rough = start_shape(CUP, first.points, places)
    elif isinstance(start, Template):
        rough = mesh_sequence(start.vertices[None], start.faces, topology=start.topology)
    else:
        rough = start
    here = stated[reference]
    begin = reference_shape(rough, image, here, sight, reference, first.points)
    if has_trabeculae(image, begin.shape, begin.sight, SHAPE[1]):
        sight = replace(sight, has_layers=True)
        begin = reference_shape(rough, image, here, sight, reference, first.points)
    shape, sight = begin.shape, begin.sight
    done()
    template = make_template(shape)
    surface = Deformable.of(template, modes)
    facets = Facets.of(template.faces, template.vertices, template.weights)
    marks, is_cup = stated, template.surface == CUP
    if is_cup:
        tip, base = ends_of_cup(template)
        marks = with_base(stated, template, reference, base + _DESCENT * (tip - base))
    walked = _walk(surface, facets, images, marks, sight, reference, is_closed, done)
    shapes = np.stack([surface.positions(a) for a in walked])
    if is_cup and marks != stated:
        by_volume, _ = base_by_volume(stated, template, reference, shapes)
        marks = with_base(stated, template, reference, by_volume)
    near = _NEXT[-1][1]
    views: list[View | None] = []
    looks: list[Sight] = []
    for k, (own, x) in enumerate(zip(images.frames, shapes, strict=True)):
        look = sight if k == reference else below_base(sight, marks[k], template)
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
    if sight.has_layers:
        views, closed = with_trabeculae(views, looks, surface, shapes, reference)
    frames: list[Frame] = []
    for view, share in zip(views, shares, strict=True):
        is_seen = view is not None and share >= LEAST_FOUND
        frames.append((view.observation(),) if view is not None and is_seen else ())
    return ImageFrames(
        tuple(frames),
        shape,
        facets,
        papillary,
        sight,
        shares,
        _notes(shares, images, begin.found),
        stated_sd,
        closed,
        begin.bent,
        {
            name: own.covariance
            for name, own in (landmarks or {}).items()
            if isinstance(own, Proposed) and own.covariance is not None
        },
    )


def _walk(
    surface: Deformable,
    facets: Facets,
    images: ImageSequence,
    marks: tuple[Frame, ...],
    sight: Sight,
    reference: int,
    is_closed: bool,
    done: Callable[[], None],
) -> Floats:
    """Amplitudes of all frames, both ways from the reference."""
    n = images.n_frames
    amplitudes = np.zeros((n, len(surface), 3))
    for path in paths_from(reference, n, is_closed=is_closed):
        a = np.zeros((len(surface), 3))
        for k in path:
            image = images.frames[k]
            if image is not None:
                look = below_base(sight, marks[k], surface.template)
                a = _next(surface, facets, image, marks[k], a, look)
            amplitudes[k] = a
            done()
    return amplitudes


def _next(
    surface: Deformable, facets: Facets, image: Image, marks: Frame, a: Floats, sight: Sight
) -> Floats:
    for modes, reach in _NEXT:
        coarse = surface if modes >= len(surface) else Deformable.of(surface.template, modes)
        prior, noise = first_guess(coarse)
        m = len(coarse)
        # What finer modes have reached stays where it is.
        rest = surface.positions(np.concatenate([np.zeros((m, 3)), a[m:]]))
        moved = replace(coarse, template=replace(coarse.template, vertices=rest))
        own = search(
            moved,
            facets,
            image,
            marks,
            a[:m],
            prior,
            noise,
            sight.within(reach),
            reach,
            is_known=True,
        )
        a = np.concatenate([own.amplitudes, a[m:]])
    return a


def _marks(
    images: ImageSequence, landmarks: Mapping[str, Any] | None, reference: int, sd: float
) -> tuple[Frame, ...]:
    return with_landmarks(tuple(() for _ in images.frames), landmarks, reference, sd)


def _notes(shares: Floats, images: ImageSequence, found: float) -> tuple[str, ...]:
    notes = list(images.notes)
    lost = [k for k, s in enumerate(shares) if s < LEAST_FOUND and images.frames[k] is not None]
    if lost:
        notes.append(
            f"In {len(lost)} frames, frame {lost[0]} the first, hardly any profile shows an edge "
            f"(reference: {found:.0%}); there the motion is interpolated."
        )
    return tuple(notes)
