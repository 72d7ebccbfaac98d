"""Covariates: what the sender knows of a case beside its motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from modalmotion.classification.options import TrainingOptions
from modalmotion.facts import Facts, Named
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature

# Where and how a case was recorded may tell classes apart, and says nothing of the motion.
CIRCUMSTANCES: Final = frozenset(
    {
        *("site", "centre", "center", "hospital", "clinic", "device", "scanner", "vendor"),
        *("manufacturer", "operator", "observer", "fold", "split", "group"),
    }
)
"""Covariates that are no features by these names; a card may test them as confounds."""


def with_covariates(
    motion: MeshSequence | ModalSignature, covariates: Mapping[str, float | str]
) -> MeshSequence | ModalSignature:
    """State covariates of a sequence or a signature, over those that it has.

    Raises
    ------
    ParameterError
        If one is neither a finite number nor a short word.
    """
    facts = Facts(covariates=covariates).over(motion.facts)
    return motion if facts == motion.facts else replace(motion, facts=facts)


def features_of(
    cases: Sequence[Mapping[str, float | str]], options: TrainingOptions
) -> tuple[Mapping[str, float | str], ...]:
    """Covariates that may be features: not those by which cases are grouped or recorded."""
    aside = {name.casefold() for name in (options.groups, options.fold) if name} | CIRCUMSTANCES
    return tuple(
        Named({name: value for name, value in case.items() if name.casefold() not in aside})
        for case in cases
    )
