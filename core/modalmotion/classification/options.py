"""How a model is trained."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import StrEnum
from typing import Any, Final

from modalmotion.arguments.checking import one_of, whole
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MEAN
from modalmotion.modes.topologies import MESH, Topology
from modalmotion.representation import plain, shown
from modalmotion.signature.making import MOST_MODES, SignatureKind, SignatureParameters

MODE_COUNTS: Final = (7, 18)
"""Numbers of modes that training weighs, where none is stated."""

_RANGES: Final = {
    "modes": (1, MOST_MODES),
    "folds": (2, 20),
    "repetitions": (1, 20),
    "seed": (0, 2**32 - 1),
}

FEWER_MODES: Final = (12, 10, 7)
"""Numbers of modes that are tried where a recording has too few vertices for the largest."""


class OnError(StrEnum):
    """What happens where a case cannot be read, fitted or compared with the others."""

    RAISE = "raise"
    LEAVE_OUT = "leave out"


class Timing(StrEnum):
    """Kind of recording: one turn of a cycle, or a movement with a beginning and an end."""

    AUTO = "auto"
    CYCLE = "cycle"
    TRANSIENT = "transient"


@shown()
@dataclass(frozen=True)
class TrainingOptions:
    """How a model is trained; every one is text or a number.

    Parameters
    ----------
    modes : int or None
        Modes of the signatures, 3 amplitudes per frame each. Features of the first 7 of them are
        weighed, too. None for 18, or as many as every recording can resolve.
    topology : str or None
        cup, sphere, ..., or mesh for spring modes: found from all cases by default.
    kind : SignatureKind or None
        material if points follow the tissue, normal_displacement if they may slide over it, by
        default what all recordings state, and else the better of both. This is found inside the
        folds.
    timing : Timing
        cycle for one period of a cycle, transient for a movement with a beginning and an end.
        AUTO weighs both where the recordings close.
    groups : str or None
        Column of the manifest, such as site. Cases that share a value are never on both sides of a
        split, nor are those of a subject.
    on_error : OnError
        LEAVE_OUT goes on without the cases that do not fit; the card names them.
    folds : int
        Folds of the grouped cross-validation.
    repetitions : int
        Repetitions of the cross-validation, each with folds of its own.
    seed : int
        Seed of all random numbers.

    Raises
    ------
    ParameterError
        If one is out of range.
    """

    modes: int | None = None
    topology: str | None = None
    kind: SignatureKind | str | None = None
    timing: Timing | str = Timing.AUTO
    groups: str | None = None
    on_error: OnError | str = OnError.RAISE
    folds: int = 5
    repetitions: int = 5
    seed: int = 0

    def __post_init__(self) -> None:
        for name, kind in (("kind", SignatureKind), ("timing", Timing), ("on_error", OnError)):
            if name != "kind" or self.kind is not None:
                object.__setattr__(self, name, one_of(name, getattr(self, name), kind))
        for name, (least, most) in _RANGES.items():
            value = getattr(self, name)
            if name == "modes" and value is None:
                continue
            if not least <= whole(name, value) <= most:
                raise _wrong(name, value, f"a whole number from {least} to {most:,}")
        if self.groups is not None and not str(self.groups).strip():
            raise _wrong("groups", self.groups, "the name of a covariate, such as site")
        if self.topology not in (None, MESH):
            object.__setattr__(self, "topology", Topology.parse(str(self.topology)).name)

    @property
    def signature_parameters(self) -> SignatureParameters:
        """Recommended parameters for the signatures of training cases.

        From the mean shape, for the shape of one frame depends on where a recording starts.
        """
        return SignatureParameters(
            modes=MODE_COUNTS[-1] if self.modes is None else self.modes,
            reference=MEAN,
            topology=self.topology,
            volumes=True,
            kind=SignatureKind.MATERIAL if self.kind is None else SignatureKind(self.kind),
        )

    def as_json(self) -> dict[str, Any]:
        """Return the options as JSON-able values."""
        return dict(plain(self))

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> "TrainingOptions":
        """Read the output of `as_json`; missing options take their defaults.

        Raises
        ------
        ParameterError
            If there is no such option, or one is out of range.
        """
        known = sorted(f.name for f in fields(TrainingOptions))
        for name in values:
            if name not in known:
                raise ParameterError(
                    f"Unknown training option {str(name)[:80]!r}.",
                    remedy=f"Use: {', '.join(known)}.",
                )
        return TrainingOptions(**values)


def _wrong(name: str, value: object, use: str) -> ParameterError:
    return ParameterError(
        f"The option '{name}' is {str(value)[:80]!r}.",
        remedy=f"Use {use}.",
        details={"option": name},
    )
