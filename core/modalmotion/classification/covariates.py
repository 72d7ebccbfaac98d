"""Covariates: what the sender knows of a case beside its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from modalmotion.facts import Facts
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
