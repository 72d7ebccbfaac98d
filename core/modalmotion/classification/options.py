"""How a model is trained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any, Final

import numpy as np

from modalmotion.errors import ParameterError
from modalmotion.facts import Named
from modalmotion.mesh.sequence import MEAN
from modalmotion.modes.topology import MESH, Topology
from modalmotion.representation import shown
from modalmotion.signature.making import MOST_MODES, SignatureKind, SignatureParameters

MOST_FOLDS: Final = 20
MOST_REPETITIONS: Final = 20
MOST_HARMONICS: Final = 8

MODE_COUNTS: Final = (7, 12, 18)
"""Numbers of modes that training weighs, where none is stated."""

FEWER_MODES: Final = (12, 10, 7)
"""Numbers of modes that are tried where a recording has too few vertices for the largest."""


class Estimator(StrEnum):
    """Kind of estimator of scores from features; `AUTO` chooses inside the training folds."""

    AUTO = "auto"
    LINEAR = "linear"
    KERNEL = "kernel"
    BLEND = "blend"
    SVM = "svm"
    FOREST = "forest"


class OnError(StrEnum):
    """What happens where a case cannot be read, fitted or compared with the others."""

    RAISE = "raise"
    LEAVE_OUT = "leave out"


class ClassWeights(StrEnum):
    """How much a case counts."""

    NONE = "none"
    BALANCED = "balanced"


class Timing(StrEnum):
    """Kind of recording: one turn of a cycle, or a movement with a beginning and an end."""

    AUTO = "auto"
    CYCLE = "cycle"
    COURSE = "course"


class CardKind(StrEnum):
    """What a card holds: `QUICK` leaves the learning curve out."""

    FULL = "full"
    QUICK = "quick"


class PoseOf(StrEnum):
    """Whether recordings share their coordinates, or may be turned any way."""

    ANY = "any"
    FIXED = "fixed"


class Walls(StrEnum):
    """Whether the zero of theta tells walls apart; `AUTO` where every case states that zero."""

    AUTO = "auto"
    YES = "yes"
    NO = "no"


@shown()
@dataclass(frozen=True)
class TrainingOptions:
    """How a model is trained; every one is text, a number or a mapping of these.

    Parameters
    ----------
    modes : int or None
        Of the signatures; see `SignatureParameters`. Features of the first 7 and 12 of them are
        weighed, too. None for 18, or as many as every recording can tell apart.
    topology : str or None
        Of the signatures: None lets the cases decide, all together. "mesh" for spring modes.
    kind : SignatureKind or None
        Of the signatures: MATERIAL where vertices follow the tissue, OFFSET where they may slide
        over it. None takes what all recordings state as their tracking; where some state none,
        both kinds are weighed inside the folds, and the model reads the better one.
    harmonics : int
        Of each part of the motion.
    timing : Timing
    pose : PoseOf
        ANY makes the answer independent of how the recording is turned.
    walls : Walls
    estimator : Estimator
    class_weights : ClassWeights or mapping of label to float
    folds : int
        Of the grouped cross-validation.
    repetitions : int
        Of the cross-validation, each with folds of its own.
    card : CardKind
    fold : str or None
        Covariate whose values are the folds; else they are drawn.
    groups : str or None
        Covariate, such as a site, whose cases are never on both sides of a split, nor are those
        of a subject. Neither of the two is a feature.
    on_error : OnError
        LEAVE_OUT goes on without the cases that do not fit; the card names them.
    coverage : float
        Level that the card reports class sets at; every answer may ask for another.
    known_share : float
        Share of cases like the training ones that the domain is to hold.
    further : bool
        Whether size, rest shape, volume curve and covariates may be read beside the motion, where
        each class has several subjects and cases left out gain by it.
    seed : int

    Raises
    ------
    ParameterError
        If one is out of range.
    """

    modes: int | None = None
    topology: str | None = None
    kind: SignatureKind | str | None = None
    harmonics: int = 2
    timing: Timing | str = Timing.AUTO
    pose: PoseOf | str = PoseOf.ANY
    walls: Walls | str = Walls.AUTO
    estimator: Estimator | str = Estimator.AUTO
    class_weights: ClassWeights | str | Mapping[str, float] = ClassWeights.NONE
    folds: int = 5
    repetitions: int = 5
    card: CardKind | str = CardKind.FULL
    fold: str | None = None
    groups: str | None = None
    on_error: OnError | str = OnError.RAISE
    coverage: float = 0.9
    known_share: float = 0.995
    further: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        for name, kind in (
            ("kind", SignatureKind),
            ("timing", Timing),
            ("pose", PoseOf),
            ("walls", Walls),
            ("estimator", Estimator),
            ("card", CardKind),
            ("on_error", OnError),
        ):
            if name == "kind" and self.kind is None:
                continue
            object.__setattr__(self, name, _member(kind, name, getattr(self, name)))
        for name, least, most in (
            ("modes", 1, MOST_MODES),
            ("harmonics", 1, MOST_HARMONICS),
            ("folds", 2, MOST_FOLDS),
            ("repetitions", 1, MOST_REPETITIONS),
            ("seed", 0, 2**32 - 1),
        ):
            value = getattr(self, name)
            if name == "modes" and value is None:
                continue
            if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
                raise ParameterError(
                    f"The option '{name}' is {value!r}.",
                    remedy=f"Use a whole number from {least} to {most:,}.",
                    details={"option": name, "least": least, "most": most},
                )
        for name in ("fold", "groups"):
            value = getattr(self, name)
            if value is not None and (not isinstance(value, str) or not value.strip()):
                raise ParameterError(
                    f"The option '{name}' is {str(value)[:80]!r}.",
                    remedy="Use the name of a covariate, such as site, or leave it out.",
                    details={"option": name},
                )
        if self.topology not in (None, MESH):
            object.__setattr__(self, "topology", Topology.parse(str(self.topology)).name)
        require_coverage(self.coverage)
        if not (_is_number(self.known_share) and 0.5 <= self.known_share < 1.0):
            raise ParameterError(
                f"The option 'known_share' is {self.known_share!r}.",
                remedy="Use a share from 0.5 to below 1; 0.995 is the default.",
            )
        weights = self.class_weights
        if isinstance(weights, Mapping):
            for label, weight in weights.items():
                if not (_is_number(weight) and np.isfinite(weight) and weight > 0):
                    raise ParameterError(
                        f"The weight of the class {str(label)[:80]!r} is {weight!r}.",
                        remedy="Use finite weights above 0.",
                    )
            frozen = Named({str(k): float(w) for k, w in weights.items()})
            object.__setattr__(self, "class_weights", frozen)
        else:
            member = _member(ClassWeights, "class_weights", weights)
            object.__setattr__(self, "class_weights", member)

    def require_classes(self, classes: Sequence[str]) -> None:
        """Check that weights are of classes that there are.

        Raises
        ------
        ParameterError
            If one is of another; it names the classes.
        """
        weights = self.class_weights
        unknown = [k for k in weights if k not in classes] if isinstance(weights, Mapping) else []
        if unknown:
            names = ", ".join(repr(name[:80]) for name in unknown[:3])
            raise ParameterError(
                f"The option 'class_weights' names {names}, and no case has such a class.",
                remedy=f"Use the names of the classes: {', '.join(classes)}.",
                details={"option": "class_weights", "classes": list(classes)},
            )

    @property
    def signature_parameters(self) -> SignatureParameters:
        """Recommended parameters for the signatures of training cases.

        From the mean shape, for the shape of one frame depends on where a recording starts.
        """
        modes = max(MODE_COUNTS) if self.modes is None else self.modes
        return SignatureParameters(
            modes=modes,
            reference=MEAN,
            topology=self.topology,
            volumes=self.further,
            kind=SignatureKind.MATERIAL if self.kind is None else SignatureKind(self.kind),
        )

    def as_json(self) -> dict[str, Any]:
        """Return the options as JSON-able values."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        if isinstance(self.class_weights, Mapping):
            values["class_weights"] = dict(self.class_weights)
        return {k: v.value if isinstance(v, StrEnum) else v for k, v in values.items()}

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> TrainingOptions:
        """Read the output of `as_json`; missing options take their defaults.

        Raises
        ------
        ParameterError
            If there is no such option, or one is out of range.
        """
        known = {f.name for f in fields(TrainingOptions)}
        unknown = sorted(set(map(str, values)) - known)
        if unknown:
            raise ParameterError(
                f"There is no training option {unknown[0][:80]!r}.",
                remedy=f"Use: {', '.join(sorted(known))}.",
            )
        return TrainingOptions(**values)


def require_coverage(coverage: float) -> None:
    """Check the level of a class set.

    Raises
    ------
    ParameterError
        If it is not above 0 and below 1.
    """
    if not (_is_number(coverage) and 0.0 < coverage < 1.0):
        raise ParameterError(
            f"The coverage is {coverage!r}.",
            remedy="Use a share above 0 and below 1, such as 0.9.",
            details={"coverage": str(coverage)},
        )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _member(kind: type[StrEnum], name: str, value: object) -> StrEnum:
    try:
        return kind(str(value))
    except ValueError:
        raise ParameterError(
            f"The option '{name}' is {str(value)[:80]!r}.",
            remedy=f"Use one of: {', '.join(kind)}.",
            details={"option": name},
        ) from None
