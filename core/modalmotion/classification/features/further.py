"""Features beside the motion: size, rest shape, enclosed volume and covariates."""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.columns import Column
from modalmotion.classification.features.invariants import (
    Waves,
    invariant_columns,
    still_invariants,
)
from modalmotion.classification.features.motion_terms import surface_size
from modalmotion.classification.features.temporal import (
    Turn,
    Turns,
    cosines,
    elapsed_share,
    harmonic_rows,
)
from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.signature.making import ModalSignature, SignatureKind

Array = NDArray[np.float64]

# A surface of no size has a logarithm all the same.
_LEAST_SIZE: Final = float(np.finfo(float).tiny)

# Harmonics of a volume curve over one turn, and twice as many cosines of one that ends elsewhere.
_N_CURVE: Final = 3


class Further(StrEnum):
    """Kind of feature beside the motion."""

    SIZE = "size"
    REST_SHAPE = "rest shape"
    VOLUME = "volume"
    VOLUME_CURVE = "volume curve"
    COVARIATES = "covariates"


@dataclass(frozen=True)
class CovariateColumn:
    """One covariate as numbers.

    Parameters
    ----------
    name : str
    mean : float
        Number that stands for one that is not stated; 0 where it is a word.
    words : tuple of str
        Words that are told apart, each a column of its own; none where it is a number.
    may_be_missing : bool
        Whether a column says that it is not stated.
    """

    name: str
    mean: float
    words: tuple[str, ...]
    may_be_missing: bool

    def values(self, covariates: Mapping[str, float | str]) -> list[float]:
        """Values of its columns."""
        value = covariates.get(self.name)
        if self.words:
            values = [float(value == word) for word in self.words]
        else:
            values = [float(value) if isinstance(value, int | float) else self.mean]
        return [*values, float(value is None)] if self.may_be_missing else values

    @property
    def columns(self) -> list[Column]:
        """Names of its columns."""
        names = [f"{self.name} = {word}" for word in self.words] or [self.name]
        if self.may_be_missing:
            names.append(f"{self.name} not stated")
        return [Column(f"covariate {name}", (), 0.0) for name in names]


def covariate_columns(
    covariates: Sequence[Mapping[str, float | str]],
) -> tuple[CovariateColumn, ...]:
    """Learn the columns of the covariates that some cases state.

    Parameters
    ----------
    covariates : sequence of mapping of str to (float or str)
        Of each case. A name that is a word in one case is one in all.
    """
    columns = []
    for name in sorted({name for one in covariates for name in one}):
        values = [one[name] for one in covariates if name in one]
        words = sorted({str(value) for value in values})
        is_word = any(isinstance(value, str) for value in values)
        numbers = [float(value) for value in values if not isinstance(value, str)]
        if len(words) < 2:
            continue
        columns.append(
            CovariateColumn(
                name=name,
                mean=0.0 if is_word else float(np.mean(numbers)),
                words=tuple(words) if is_word else (),
                may_be_missing=len(values) < len(covariates),
            )
        )
    return tuple(columns)


def log_size(size: float, unit: str | None) -> Array:
    """Logarithm of a surface's size, in mm where the unit is known, (1,) float64."""
    return np.array([math.log(max(size, _LEAST_SIZE) * MM_PER_UNIT.get(unit or "", 1.0))])


SIZE_COLUMNS: Final = (Column("log size", (), 0.0),)


def rest_shape(signature: ModalSignature, waves: Waves) -> Array:
    """Shape of the mean of all frames, whatever its pose and size, (features,) float64.

    Roots of products of its own amplitudes over their size: see `invariants`. The first mode,
    which moves the whole, is zero.
    """
    shape = signature.reference_amplitudes.copy()
    # Offsets are along normals, not along x, y, z: there the reference itself is read.
    if signature.kind == SignatureKind.MATERIAL:
        shape += np.add.reduce(signature.amplitudes) / signature.n_frames
    shape[0] = 0.0
    size = math.sqrt(np.vdot(shape, shape))
    return still_invariants(shape / size if size > 0 else shape, waves)


def rest_shape_columns(waves: Waves) -> tuple[Column, ...]:
    """Columns of the values of `rest_shape`."""
    return tuple(Column(f"rest shape: {column.name}", (), 0.0) for column in _still(waves))


@lru_cache(maxsize=64)
def _still(waves: Waves) -> tuple[Column, ...]:
    """Columns of one still term: nothing is ahead of anything."""
    columns = invariant_columns(waves, 1, 3, is_cycle=False)
    return tuple(c for c in columns if c.name.startswith(("size", "together", "spread")))


def has_volume(signature: ModalSignature) -> bool:
    """Whether the signature holds a volume that stays positive."""
    return signature.volumes is not None and bool((signature.volumes > 0).all())


def volume_values(signature: ModalSignature) -> Array:
    """Largest volume as a length, and the share of it that is lost, (2,) float64.

    A third of its logarithm, and 1 - smallest / largest.
    """
    volumes = signature.volumes
    assert volumes is not None  # noqa: S101 (see `has_volume`)
    largest, smallest = float(np.maximum.reduce(volumes)), float(np.minimum.reduce(volumes))
    length = math.log(largest) / 3.0 + math.log(MM_PER_UNIT.get(signature.unit or "", 1.0))
    return np.array([length, 1.0 - smallest / largest])


VOLUME_COLUMNS: Final = tuple(
    Column(name, (), 0.0) for name in ("log largest volume / 3", "share of volume lost")
)


def volume_curve(signature: ModalSignature, *, is_cycle: bool, turn: Turn | None = None) -> Array:
    """Course of the volume over its largest, (features,) float64.

    Of a cycle the size of the first harmonic, and the others in phase and out of phase with it;
    else the first cosines.
    """
    volumes = signature.volumes
    assert volumes is not None  # noqa: S101 (see `has_volume`)
    relative = volumes / np.maximum.reduce(volumes)
    if not is_cycle:
        share = elapsed_share(signature)
        return cosines(share, relative[:, None], 2 * _N_CURVE)[:, 0]
    share = (turn or Turns(signature).of_first()).share
    rows = harmonic_rows(share, relative[: len(share)], _N_CURVE).tolist()
    harmonics = [complex(*both) for both in zip(rows[:_N_CURVE], rows[_N_CURVE:], strict=True)]
    clock = cmath.phase(harmonics[0])
    turned = [c * cmath.rect(1.0, -h * clock) for h, c in enumerate(harmonics, start=1)]
    # The first harmonic is in phase with itself.
    return np.array([c.real for c in turned] + [c.imag for c in turned[1:]])


def volume_curve_columns(*, is_cycle: bool) -> tuple[Column, ...]:
    """Columns of the values of `volume_curve`."""
    terms = range(1, _N_CURVE + 1)
    if is_cycle:
        names = [f"harmonic {h}, in phase" for h in terms]
        names += [f"harmonic {h}, out of phase" for h in terms if h > 1]
    else:
        names = [f"term {k}" for k in range(1, 2 * _N_CURVE + 1)]
    return tuple(Column(f"volume curve {name}", (), 0.0) for name in names)


def further_values(
    kind: Further,
    signature: ModalSignature,
    waves: Waves | None,
    *,
    is_cycle: bool,
    turn: Turn | None = None,
) -> Array:
    """Values of one kind of feature, but for covariates, (features,) float64.

    Parameters
    ----------
    kind : Further
    signature : ModalSignature
    waves : Waves or None
        Of the signature; the rest shape needs them.
    is_cycle : bool
    turn : Turn, optional
        Of the signature, where it is known; a volume curve reads it.
    """
    if kind == Further.SIZE:
        return log_size(surface_size(signature), signature.unit)
    if kind == Further.REST_SHAPE:
        assert waves is not None  # noqa: S101 (see above)
        return rest_shape(signature, waves)
    if kind == Further.VOLUME:
        return volume_values(signature)
    return volume_curve(signature, is_cycle=is_cycle, turn=turn)


def further_columns(
    kinds: tuple[Further, ...],
    waves: Waves,
    covariates: tuple[CovariateColumn, ...],
    *,
    is_cycle: bool,
) -> tuple[Column, ...]:
    """Columns of `further_values` of several kinds, and of covariates."""
    columns = {
        Further.SIZE: SIZE_COLUMNS,
        Further.REST_SHAPE: rest_shape_columns(waves),
        Further.VOLUME: VOLUME_COLUMNS,
        Further.VOLUME_CURVE: volume_curve_columns(is_cycle=is_cycle),
        Further.COVARIATES: tuple(c for column in covariates for c in column.columns),
    }
    return tuple(column for kind in kinds for column in columns[kind])
