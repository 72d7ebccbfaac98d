"""The shape that images show in the reference frame, from landmarks on."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.images import PlaneSet
from modalmotion.images.sequence import Image
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.template import make_template
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.folding import require_unfolded
from modalmotion.tracking.image_search import search
from modalmotion.tracking.image_view import Facets, Sight
from modalmotion.tracking.observation import Frame, Observation
from modalmotion.tracking.passes import first_guess
from modalmotion.tracking.plane_shifts import left_by_shifts
from modalmotion.tracking.settling import settle

Floats = NDArray[np.float64]

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
    sight : Sight
    found : float
        Share of the profiles with an edge.
    bent : (vertices,) float64, mm
        Deviation across the surface that shifts of slices leave; zero where there are none.
    """

    shape: MeshSequence
    sight: Sight
    found: float
    bent: Floats


def reference_shape(
    rough: MeshSequence,
    image: Image,
    marks: Frame,
    sight: Sight,
    number: int,
    points: Floats,
) -> ReferenceShape:
    """Search for it coarse to fine, with levels, bias field and shifts of slices.

    Parameters
    ----------
    rough : MeshSequence
        What the search begins on.
    image : Volume or PlaneSet
    marks : Frame
        Landmarks of this frame.
    sight : Sight
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
            # Wherever a start lies, and however wide it is, rays from the axis met the edge there.
            variances = prior.variances(surface.wavenumbers)
            a = settle(surface, (Observation(points), *marks), a, variances, noise).amplitudes
        state = search(
            surface,
            facets,
            image,
            marks,
            a,
            prior,
            noise,
            sight.within(reach),
            reach,
            sights_too=not is_cold,
            evidence_too=not is_cold,
        )
        a, sight, found = state.amplitudes, state.sight, state.view.found
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
        seen = (state.view.observation(), *marks)
        own = state.prior, state.noise, state.sight
        bent = left_by_shifts(surface, seen, state.view, a, *own, facets.normals(x))
    return ReferenceShape(fitted, sight, found, bent)
