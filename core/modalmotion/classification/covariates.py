"""Covariates: what the sender knows of a case beside its motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

from modalmotion.classification.circumstances import is_circumstance
from modalmotion.classification.options import TrainingOptions
from modalmotion.facts import Facts, Named
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature

# More names make a note hard to read.
_MOST_NAMED: Final = 5


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


def covariate_notes(read: Iterable[str], stated: Mapping[str, float | str]) -> tuple[str, ...]:
    """Say which covariates of a case a model does not know, and which it misses.

    Parameters
    ----------
    read : iterable of str
        Names of those that the model reads.
    stated : mapping of str to (float or str)
        Of the case; those that say how it was recorded no model reads.
    """
    known = sorted(set(read))
    unknown = [name for name in stated if name not in known and not is_circumstance(name)]
    missing = [name for name in known if name not in stated]
    notes = []
    if unknown:
        notes.append(
            f"The model knows no covariate {_listed([repr(name) for name in unknown])}; it reads "
            f"{_listed(known) or 'none'}."
        )
    if missing:
        notes.append(
            f"The model reads {_listed(known)}; not stated of this case: {_listed(missing)}."
        )
    return tuple(notes)


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    shown = ", ".join(name[:80] for name in names[:_MOST_NAMED])
    return f"{shown} and {more} more" if more > 0 else shown
