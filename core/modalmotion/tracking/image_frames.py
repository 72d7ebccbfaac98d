"""Images become observations: edges in every frame, found from the reference on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError
from modalmotion.images import ImageSequence, PlaneSet
from modalmotion.images.sequence import Image
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CUP
from modalmotion.template import Template, make_template
from modalmotion.tracking.closing import has_trabeculae, with_trabeculae
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.image_doubts import doubts_of
from modalmotion.tracking.image_levels import as_bright, first_sight
from modalmotion.tracking.image_search import search
from modalmotion.tracking.image_view import Facets, Sight, View, view_of
from modalmotion.tracking.landmark_path import path_between
from modalmotion.tracking.landmarks import Proposed
from modalmotion.tracking.moving_base import below_base, with_base
from modalmotion.tracking.observation import Frame
from modalmotion.tracking.papillary import CONVENTIONS, Papillary
from modalmotion.tracking.passes import first_guess
from modalmotion.tracking.reference_shape import LEAST_FOUND, SHAPE, reference_shape
from modalmotion.tracking.request import with_landmarks
from modalmotion.tracking.start import start_shape
from modalmotion.tracking.stated_start import begun
from modalmotion.tracking.still_tip import held, tip_of

Floats = NDArray[np.float64]

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
        Profiles without landmarks; empty where nothing was found.
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
        Of proposed apex and base, and of a base that few frames state: covariance of errors along
        the axis.
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
    soft = path_between(landmarks, images.n_frames, is_closed=is_closed)
    stated_sd = _STATED * images.finest
    stated = _marks(images, landmarks, reference, stated_sd)
    marks = tuple((*a, *b) for a, b in zip(stated, soft, strict=True))
    places = _places(marks[reference])
    image = images.frames[reference]
    if image is None:
        raise ShapeError(
            f"Frame {reference}, which the shape is taken from, is missing.",
            remedy="Name a reference frame that is there.",
            frame=reference,
        )
    if not {"apex", "base"} <= set(places):
        raise ParameterError(
            "Images say where edges are, and not which: the landmarks apex and base are missing "
            f"in the reference frame {reference}.",
            remedy="State apex=x,y,z and base=x,y,z (the middle of the opening) in LPS mm.",
            frame=reference,
            details={"needed": ["apex", "base"]},
        )
    first = first_sight(image, places["apex"], places["base"], reference)
    n_planes = len(image) if isinstance(image, PlaneSet) else 1
    middle = (places["apex"] + places["base"]) / 2.0
    sight = Sight(first.levels, np.zeros(3), middle, np.zeros((n_planes, 3)))
    if start is None:
        rough = start_shape(CUP, first.points, places)
    else:
        rough = begun(start, first.points, places)
    here = marks[reference]
    begin = reference_shape(rough, image, here, sight, reference, first.points)
    if has_trabeculae(image, begin.shape, begin.sight, SHAPE[1]):
        sight = replace(sight, has_layers=True)
        begin = reference_shape(rough, image, here, sight, reference, first.points)
    shape, sight = begin.shape, begin.sight
    done()
    template = make_template(shape)
    surface = Deformable.of(template, modes)
    facets = Facets.of(template.faces, template.vertices, template.weights)
    # Whoever states where the apex goes knows better.
    is_still = sum("apex" in _places(frame) for frame in stated) < 2
    still = replace(sight, tip=tip_of(template) if is_still else None)
    marks, variances = with_base(held(marks, template, reference), stated, template, reference)
    walked = _walk(surface, facets, images, marks, still, reference, is_closed, done)
    shapes = np.stack([surface.positions(a) for a in walked])
    near = _NEXT[-1][1]
    views: list[View | None] = []
    looks: list[Sight] = []
    for k, (own, x) in enumerate(zip(images.frames, shapes, strict=True)):
        look = sight if k == reference else below_base(still, marks[k], template)
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
    for view, share, own_marks, known in zip(views, shares, marks, stated, strict=True):
        is_seen = view is not None and share >= LEAST_FOUND
        between = own_marks[len(known) :]
        frames.append((view.observation(), *between) if view is not None and is_seen else ())
    doubts = doubts_of(image, facets, template.vertices, sight, places["apex"], places["base"])
    notes = (*_notes(shares, images, begin.found), *doubts)
    return ImageFrames(
        tuple(frames),
        shape,
        facets,
        papillary,
        sight,
        shares,
        notes,
        stated_sd,
        closed,
        begin.bent,
        _levels(landmarks or {}, variances),
    )


def _levels(landmarks: Mapping[str, Any], variances: Floats) -> dict[str, Floats]:
    """Covariances of the levels of ends that nobody states exactly."""
    levels = {
        name: own.covariance
        for name, own in landmarks.items()
        if isinstance(own, Proposed) and own.covariance is not None
    }
    return levels if not variances.any() else {"base": np.diag(variances), **levels}


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
    if is_closed:
        half = n // 2
        paths = [
            [(reference + i) % n for i in range(1, half + 1)],
            [(reference - i) % n for i in range(1, n - half)],
        ]
    else:
        paths = [list(range(reference + 1, n)), list(range(reference - 1, -1, -1))]
    for path in paths:
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
            sights_too=False,
            evidence_too=False,
        )
        a = np.concatenate([own.amplitudes, a[m:]])
    return a


def _marks(
    images: ImageSequence, landmarks: Mapping[str, Any] | None, reference: int, sd: float
) -> tuple[Frame, ...]:
    return with_landmarks(tuple(() for _ in images.frames), landmarks, reference, sd)


def _places(marks: Frame) -> dict[str, Floats]:
    return {
        name: part.points[i]
        for part in marks
        for i, name in enumerate(part.places or ())
        if isinstance(name, str)
    }


def _notes(shares: Floats, images: ImageSequence, found: float) -> tuple[str, ...]:
    notes = list(images.notes)
    lost = [k for k, s in enumerate(shares) if s < LEAST_FOUND and images.frames[k] is not None]
    if lost:
        notes.append(
            f"In {len(lost)} frames, frame {lost[0]} the first, hardly any profile shows an edge "
            f"(reference: {found:.0%}); there the motion is interpolated."
        )
    return tuple(notes)
