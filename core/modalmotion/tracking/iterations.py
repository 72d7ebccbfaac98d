"""Iterations: each frame at rest by itself, and what the frames say of prior and noise.

a = argmin sum w (n . (y - x(a)))^2 / s^2 + a' K a: the place where the oscillators of (3), driven
by the force that the data exert, come to rest. Gauss-Newton goes there in a few steps, each of
which matches points and surface anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np

from modalmotion.numeric.scales import gram, inverse_of_cholesky
from modalmotion.representation import Floats
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.noise import Noise, Prior, Residuals, most_likely_prior, noise_of
from modalmotion.tracking.normal_equations import NormalEquations, normal_equations
from modalmotion.tracking.observation import Frame

_MOST_STEPS: Final = 12

# A step of a tenth of the standard deviation in each amplitude, squared.
_SMALL: Final = 0.01


@dataclass(frozen=True, eq=False)
class FrameEstimate:
    """A frame at rest.

    Parameters
    ----------
    amplitudes : (modes, 3) float64, length unit
    information : NormalEquations
        About the shape before the last step.
    covariance : (3 modes, 3 modes) float64, length unit squared
        (A + K)^-1.
    """

    amplitudes: Floats
    information: NormalEquations
    covariance: Floats


def map_frame(
    surface: Deformable,
    frame: Frame,
    start: Floats,
    variances: Floats,
    noise: Noise,
    most_steps: int = _MOST_STEPS,
) -> FrameEstimate:
    """Find the equilibrium of one frame by Gauss-Newton.

    Parameters
    ----------
    surface : Deformable
    frame : Frame
    start : (modes, 3) float64, length unit
    variances : (modes,) float64, length unit squared
        K^-1.
    noise : Noise
    most_steps : int
    """
    stiffness = surface.stiffness(variances)
    a = start
    for _ in range(most_steps):
        found = normal_equations(surface, a, frame, noise)
        H = found.matrix + stiffness
        inverse = inverse_of_cholesky(H)
        new = (inverse.T @ (inverse @ found.vector[:, None])).reshape(-1, 3)
        change = (new - a).ravel()
        a = new
        if float(change @ (H @ change[:, None])[:, 0]) <= _SMALL * len(change):
            break
    return FrameEstimate(a, found, gram(inverse))


# Of the size: no prior is narrower. No noise is either: one point that fits exactly would weigh as
# many digits more than the prior as there are.
LEAST: Final = 1e-9
_LEAST_NOISE: Final = 1e-6

# Of the size: what points may be off the start by at first.
_FIRST_NOISE: Final = 0.02


Iteration: TypeAlias = list[FrameEstimate | None]
"""All frames at rest, each by itself; None where nothing was observed."""


def amplitudes_of(surface: Deformable, here: Iteration) -> Floats:
    """Amplitudes, (frames, modes, 3); those of a missing frame are its neighbour's."""
    full = np.zeros((len(here), len(surface), 3))
    for k, own in enumerate(here):
        full[k] = full[k - 1] if own is None else own.amplitudes
    return full


def frames_at_rest(
    surface: Deformable,
    frames: Sequence[Frame],
    prior: Prior,
    noise: Noise,
    paths: Sequence[Sequence[int]],
    done: Callable[[], None],
    starts: Floats | None = None,
) -> Iteration:
    """Estimate frame after frame along paths that all go on from the first one.

    Parameters
    ----------
    surface : Deformable
    frames : sequence of Frame
    prior : Prior
    noise : Noise
    paths : sequence of sequence of int
        As of `paths_from`.
    done : callable
        Called after each frame.
    starts : (frames, modes, 3) float64, length unit, optional
        Where frames are; by default each is where the one before it on its path is.
    """
    variances = prior.variances(surface.wavenumbers)
    found: Iteration = [None] * len(frames)
    first = a = np.zeros((len(surface), 3))
    for number, path in enumerate(paths):
        for k in path:
            if any(map(len, frames[k])):
                start = a if starts is None else starts[k]
                found[k] = own = map_frame(surface, frames[k], start, variances, noise)
                a = own.amplitudes
            done()
        a = first = first if number else a
    return found


def paths_from(first: int, n: int, *, is_closed: bool) -> tuple[list[int], ...]:
    """List the first frame, those after it, and those before; of a cycle half the way each."""
    if not is_closed:
        return [first], [*range(first + 1, n)], [*range(first - 1, -1, -1)]
    half = n // 2
    there = [(first + i) % n for i in range(1, half + 1)]
    return [first], there, [(first - i) % n for i in range(1, n - half)]


def evidence(
    surface: Deformable,
    estimates: Sequence[FrameEstimate | None],
    prior: Prior,
    *,
    is_exact: bool = True,
) -> tuple[Prior, Noise]:
    """Find the prior and the noise under which frames at rest are the most likely.

    Where the start is exact, as that of a single frame, nothing is left where nothing moves.
    """
    n = len(surface)
    energies, determined = np.zeros(n), np.zeros(n)
    v = prior.variances(surface.wavenumbers)
    kept = [own for own in estimates if own is not None]
    for own in kept:
        energies += (own.amplitudes**2).sum(axis=1)
        share = 1.0 - np.diag(own.covariance).reshape(-1, 3) / v[:, None]
        determined += np.maximum(share, 0.0).sum(axis=1)
    least = LEAST * surface.size
    found = most_likely_prior(surface.wavenumbers, energies, determined, least)
    _, n_values = found.beyond(surface.wavenumbers, surface.template.topology.n_axes)
    left = [
        Residuals(
            own.information.points,
            own.information.residuals,
            own.information.weights,
            # tr (A C): the amplitudes that the data have set.
            float((own.information.matrix * own.covariance).sum()),
            energy(surface, own.amplitudes, found),
        )
        for own in kept
    ]
    noise = noise_of(left, n_values, surface.template.topology.n_axes, is_exact=is_exact)
    return found, replace(noise, sd=max(noise.sd, _LEAST_NOISE * surface.size))


def energy(surface: Deformable, amplitudes: Floats, prior: Prior) -> float:
    """Mean over modes and directions of a^2 over its prior variance, translation left out."""
    moves = surface.wavenumbers > 0
    v = prior.variances(surface.wavenumbers)[moves]
    return float((amplitudes[moves] ** 2 / v[:, None]).mean())


def noises_of(surface: Deformable, here: Iteration, prior: Prior, noise: Noise) -> list[Noise]:
    """Noise of each frame, from that of all."""
    return [noise.of_frame(energy(surface, a, prior)) for a in amplitudes_of(surface, here)]


def steady(noises: Sequence[Noise], noise: Noise) -> Noise:
    """Noise of all frames alike.

    Estimated with what grows with the motion, a frame would be drawn to the start the more the
    farther it moves.
    """
    mean = float(np.sqrt(np.mean([own.truncation**2 for own in noises])))
    return replace(noise, truncation=mean, lasting=0.0)


def first_guess(surface: Deformable) -> tuple[Prior, Noise]:
    """Prior and noise before anything was seen."""
    prior = Prior.broad(surface.size)
    beyond, n_values = prior.beyond(surface.wavenumbers, surface.template.topology.n_axes)
    return prior, Noise(_FIRST_NOISE * surface.size, float(np.sqrt(beyond)), n_values)
