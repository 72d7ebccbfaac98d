"""Covariates: what the sender knows of a case beside its motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from modalmotion.classification.circumstances import is_circumstance
from modalmotion.classification.options import TrainingOptions
from modalmotion.facts import Facts, Named
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature


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
    """Covariates that may be features: not those by which cases are grouped or recorded.

    How a case was recorded may tell classes apart, and says nothing of the motion: a card tests
    it as a confound.
    """
    aside = {name.casefold() for name in (options.groups, options.fold) if name}
    names = {name for case in cases for name in case}
    used = {name for name in names if name.casefold() not in aside and not is_circumstance(name)}
    return tuple(
        Named({name: value for name, value in case.items() if name in used}) for case in cases
    )
