"""Tables of features: what is read of a motion, and of the volume of its cavity."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.motion import N_COSINES, N_HARMONICS, Column, Complex, Motion
from modalmotion.classification.motion_features import (
    axis_columns,
    axis_parts,
    has_axis,
    summary,
    summary_columns,
    theta_is_free,
    wave_columns,
    wave_features,
    waves_of,
)
from modalmotion.classification.options import Timing
from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.modes import Modes
from modalmotion.representation import shown

AXIS: Final = "axis"
SUMMARY: Final = "summary"
WAVES: Final = "modes"
TERMS: Final = "terms"

VOLUME: Final = "volume"

_IN_WORDS: Final = {
    AXIS: "parts about the axis",
    SUMMARY: "a few numbers of the modes",
    WAVES: "modes and their products",
    TERMS: "modes, their products and terms",
    VOLUME: "volume",
}

# A cycle whose next frame would be the first closes within this many usual steps.
_CLOSED: Final = 2.5
# Percent of the size: less motion than this counts as rest.
_LEAST_TOTAL: Final = 1e-2
# Starts that are tried where a cycle is begun like the typical one, and rounds of its mean.
_N_STARTS: Final = 192
_N_ROUNDS: Final = 6

Array = NDArray[np.float64]


@shown("description")
@dataclass(frozen=True, eq=False)
class Extractor:
    """One table of features.

    Parameters
    ----------
    what : str
        AXIS, SUMMARY, WAVES or TERMS of the motion, or VOLUME of a cavity.
    is_cycle : bool
        Whether a recording is one turn of a cycle, which may start anywhere, or a transient.
    n_modes : int
        First modes that are read.
    walls : bool
        Whether the zero of theta is a known place on the body.
    typical : (harmonics, modes, n) complex128 or None
        Cycle that others are begun like, before their terms are features.
    """

    what: str
    is_cycle: bool = True
    n_modes: int = 0
    walls: bool = False
    typical: Complex | None = None

    @property
    def description(self) -> str:
        """The features, in words."""
        time = "a cycle" if self.is_cycle else "a transient"
        of_motion = f"{_IN_WORDS[self.what]} of {self.n_modes} modes over {time}"
        return of_motion if self.reads_motion else self.what

    @property
    def reads_motion(self) -> bool:
        """Whether it reads the motion itself, and not the volume of its cavity."""
        return self.what != VOLUME

    @property
    def learns(self) -> bool:
        """Whether it depends on a typical motion, which training cases give."""
        return self.what == TERMS and self.is_cycle

    def fitted(self, motions: Iterable[Motion]) -> Extractor:
        """Learn what is learnt, from some motions."""
        if not self.learns:
            return self
        return replace(self, typical=typical_motion([self.terms(motion) for motion in motions]))

    def values(self, motion: Motion) -> Array:
        """Features of a motion, (features,) float64.

        Of parts about the axis in percent of the size, their roots where they have no sign; else
        the log of how much moves, and what share of it moves how.
        """
        modes = first(motion.modes, self.n_modes)
        if self.what == VOLUME:
            return _volume(motion)
        if self.what == AXIS:
            return axis_parts(motion.harmonics[:, : self.n_modes], modes, walls=self.walls)
        terms = self.terms(motion)
        total = math.sqrt(float((np.abs(terms) ** 2).sum()))
        shares: NDArray[Any] = terms / total if total > 0.0 else terms
        waves = waves_of(modes, walls=self.walls)
        read = summary if self.what == SUMMARY else wave_features
        parts: list[Any] = [[math.log(max(total, _LEAST_TOTAL))], read(shares, waves)]
        if self.typical is not None:
            begun = begun_like(shares[None], self.typical)[0]
            parts += [begun.real.ravel(), begun.imag.ravel()]
        elif self.what == TERMS:
            parts.append(np.real(shares).ravel())
        return np.concatenate(parts)

    def terms(self, motion: Motion) -> NDArray[Any]:
        """Terms over time of the modes that are read, (terms, modes, n)."""
        return (motion.harmonics if self.is_cycle else motion.cosines)[:, : self.n_modes]

    def columns(self, motion: Motion) -> tuple[Column, ...]:
        """Columns of the values of motions in the same modes."""
        modes = first(motion.modes, self.n_modes)
        waves = waves_of(modes, walls=self.walls)
        n_terms = N_HARMONICS if self.is_cycle else N_COSINES
        n = motion.amplitudes.shape[2]
        if self.what == VOLUME:
            return Column("log largest volume / 3"), Column("share of volume lost")
        if self.what == AXIS:
            return axis_columns(modes, n_terms, is_offset=n == 1, walls=self.walls)
        columns = [Column("log motion", tuple(range(self.n_modes)))]
        if self.what == SUMMARY:
            columns += summary_columns(waves, n_terms, n, is_cycle=self.is_cycle)
        else:
            columns += wave_columns(waves, n_terms, n)
        if self.what == TERMS:
            columns += [
                Column(f"{part}term {h + 1} {modes.labels[k]} {'xyz'[i]}", (k,))
                for part in (("cos ", "sin ") if self.is_cycle else ("",))
                for h in range(n_terms)
                for k in range(len(modes))
                for i in range(n)
            ]
        return tuple(columns)

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON-able values, its typical motion as a shape."""
        values = {name: value for name, value in vars(self).items() if name != "typical"}
        return {**values, "typical": None if self.typical is None else self.typical.shape}

    @staticmethod
    def from_json(values: Mapping[str, Any], typical: Array) -> Extractor:
        """Read the output of `as_json`, and the real and imaginary parts of the typical motion.

        Raises
        ------
        ValueError
            If it reads what there is not.
        """
        if values["what"] not in _IN_WORDS:
            raise ValueError("it reads what no model reads")
        motion = None
        if values["typical"] is not None:
            real, imaginary = typical.reshape(2, *map(int, values["typical"]))
            motion = real + 1j * imaginary
        return Extractor(**{**values, "typical": motion})


def first(modes: Modes, n: int) -> Modes:
    """Return the first n modes."""
    return modes if n >= len(modes) else modes.take(np.arange(n))


def reads_about_axis(motion: Motion, n_modes: int) -> bool:
    """Whether parts about an axis can be read of a motion."""
    return motion.signature.landmarks is not None and has_axis(first(motion.modes, n_modes))


def kinds_of(
    motions: Sequence[Motion], n_modes: int, *, is_cycle: bool, walls: bool
) -> tuple[str, ...]:
    """Give the kinds of features of the motion that all recordings have, the simplest first."""
    has_axis = is_cycle and all(reads_about_axis(motion, n_modes) for motion in motions)
    # Terms as they are mean nothing where theta may start anywhere.
    is_free = theta_is_free(first(motions[0].modes, n_modes), walls=walls)
    return (*((AXIS,) if has_axis else ()), SUMMARY, WAVES, *(() if is_free else (TERMS,)))


def states_walls(motions: Sequence[Motion]) -> bool:
    """Whether every recording states the zero of theta."""
    landmarks = [motion.signature.landmarks for motion in motions]
    return all(one is not None and "theta_zero" in one.given for one in landmarks)


def timings_of(motions: Sequence[Motion], timing: Timing | str) -> tuple[bool, ...]:
    """Give whether recordings may be cycles, and transients: (True, False) where both may be."""
    if timing != Timing.AUTO:
        return (timing == Timing.CYCLE,)
    gaps = [motion.signature.closure_gap for motion in motions]
    return (True, False) if float(np.median(gaps)) < _CLOSED else (False,)


def volume_share(motion: Motion) -> float:
    """Share of the volume of a cavity that is lost, as an ejection fraction; NaN without one."""
    volumes = motion.volumes
    return math.nan if volumes is None else 1.0 - float(volumes.min() / volumes.max())


def begun_like(motions: Complex, typical: Complex) -> Complex:
    """Start cycles so that each overlaps most with a typical one.

    Parameters
    ----------
    motions : (motions, harmonics, modes, n) complex128
    typical : (harmonics, modes, n) complex128

    Notes
    -----
    A start t later multiplies harmonic h by exp(i h t).
    """
    h = np.arange(1, len(typical) + 1)
    starts = np.arange(_N_STARTS) * (2 * np.pi / _N_STARTS)
    overlaps = np.einsum("hij,nhij->nh", typical.conj(), motions)
    best = (np.exp(1j * starts[:, None] * h) @ overlaps.T).real.argmax(axis=0)
    return np.asarray(motions * np.exp(1j * starts[best, None] * h)[:, :, None, None])


def typical_motion(motions: Sequence[Complex]) -> Complex:
    """Mean of cycles of one size, each begun like it: (harmonics, modes, n) complex128."""
    sizes = [np.linalg.norm(motion) for motion in motions]
    units = np.stack([m / size if size > 0 else m for m, size in zip(motions, sizes, strict=True)])
    mean = units[int(np.argsort(sizes, kind="stable")[len(sizes) // 2])]
    for _ in range(_N_ROUNDS):
        mean = begun_like(units, mean).mean(axis=0)
    return np.asarray(mean)


def _volume(motion: Motion) -> Array:
    volumes = motion.volumes
    assert volumes is not None  # noqa: S101 (asked for only of motions that have one)
    unit = math.log(MM_PER_UNIT.get(motion.signature.unit or "", 1.0))
    return np.array([math.log(volumes.max()) / 3.0 + unit, volume_share(motion)])
