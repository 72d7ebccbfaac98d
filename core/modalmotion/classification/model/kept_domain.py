"""The domain of a model as arrays and texts."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.twins import TWINS
from modalmotion.classification.model.domain import ARRAYS, CHECKS, COURSE, PLACE, Domain
from modalmotion.classification.model.kept_members import Values, reader_of
from modalmotion.hdf5.contents import Contents
from modalmotion.hdf5.image import json_text

_DOMAIN: Final = ("has_unit", "hand_is_stated", "hand_temperature")


def domain_arrays(domain: Domain) -> dict[str, NDArray[Any]]:
    """Take a domain to pieces, but for its reader."""
    facts = {name: getattr(domain, name) for name in _DOMAIN}
    return {
        **{name: getattr(domain, name) for name in ARRAYS},
        "least": np.array([domain.least_motion, domain.least_smooth]),
        "domain": np.asarray(json_text("domain", facts).values),
    }


def domain_of(contents: Contents, n: int) -> Domain:
    """Read the domain of a model of n classes."""
    means = contents.array("means", (n, None))
    d, n_twins = means.shape[1], len(TWINS)
    least_motion, least_smooth = contents.array("least", (2,)).tolist()
    facts = contents.json("domain", dict)
    return Domain(
        reader=reader_of(contents.json("domain_reader", dict), Values(np.zeros(0))),
        means=means,
        whitening=contents.array("whitening", (d, d)),
        spreads=contents.array("spreads", (n,)),
        points=contents.array("points", (None, len(PLACE))),
        scales=contents.array("scales", (len(PLACE),)),
        directions=contents.array("directions", (n_twins, d)),
        centres=contents.array("centres", (n, n_twins)),
        course=contents.array("course", (2, len(COURSE))),
        limits=contents.array("limits", (len(CHECKS),)),
        least_motion=least_motion,
        least_smooth=least_smooth,
        has_unit=None if facts["has_unit"] is None else bool(facts["has_unit"]),
        hand_is_stated=bool(facts["hand_is_stated"]),
        hand_temperature=float(facts["hand_temperature"]),
    )
