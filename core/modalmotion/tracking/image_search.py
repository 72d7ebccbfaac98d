"""A surface drawn to the edges of one image, coarse to fine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.images import PlaneSet
from modalmotion.images.sequence import Image
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.image_levels import renewed
from modalmotion.tracking.image_view import Facets, Sight, View, view_of
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame
from modalmotion.tracking.passes import evidence
from modalmotion.tracking.plane_shifts import with_shifts
from modalmotion.tracking.prior import Prior
from modalmotion.tracking.settling import settle

Floats = NDArray[np.float64]

# Steps of one stage, and RMS of the last one, mm.
_MOST_STEPS: Final = 8
_SMALL: Final = 0.1


@dataclass(frozen=True, eq=False)
class Search:
    """Where a search stands.

    Parameters
    ----------
    amplitudes : (modes, 3) float64, mm
    prior : Prior
    noise : Noise
    sight : Sight
    view : View
        About the shape before the last step.
    """

    amplitudes: Floats
    prior: Prior
    noise: Noise
    sight: Sight
    view: View


def search(
    surface: Deformable,
    facets: Facets,
    image: Image,
    marks: Frame,
    start: Floats,
    prior: Prior,
    noise: Noise,
    sight: Sight,
    reach: float,
    *,
    sights_too: bool,
    evidence_too: bool,
) -> Search:
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
    sight : Sight
    reach : float, mm
    sights_too, evidence_too : bool
        Whether levels, bias field and shifts of slices, and whether prior and noise are estimated
        with the shape.
    """
    a = start
    view = view_of(image, facets, surface.positions(a), sight, reach)
    for step in range(_MOST_STEPS):
        frame: Frame = (view.observation(), *marks)
        variances = prior.variances(surface.wavenumbers)
        if sights_too and isinstance(image, PlaneSet):
            own, sight = with_shifts(surface, frame, view, a, prior, noise, sight)
        else:
            own = settle(surface, frame, a, variances, noise, most_steps=2)
        change = float(np.linalg.norm(own.amplitudes - a))
        a = own.amplitudes
        if evidence_too and step:
            prior, noise = evidence(surface, [own], prior)
        sight = renewed(sight, view) if sights_too and step else sight
        if change < _SMALL:
            break
        view = view_of(image, facets, surface.positions(a), sight, reach)
    return Search(a, prior, noise, sight, view)
