"""A fitted motion: amplitudes of some modes, limited on request, and their errors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.harmonics import harmonics_of, require_harmonics
from modalmotion.choice.parameters import ErrorKind
from modalmotion.choice.reason import ModelChoice
from modalmotion.choice.scene import LinearMotion
from modalmotion.fit.basis import Basis
from modalmotion.fit.fit import Fit
from modalmotion.fit.superposition import measured
from modalmotion.mesh.alignment import Rotations
from modalmotion.modes import Modes
from modalmotion.numeric.scale import root_mean_square


@dataclass(frozen=True, eq=False)
class Model:
    """Amplitudes of a set of modes, with their true error.

    Parameters
    ----------
    basis : Basis
        The modes, factored.
    fit : Fit
        Its errors are those of these amplitudes.
    choice : ModelChoice or None
        How the modes were chosen, where their number was not stated.
    notes : tuple of str
    """

    basis: Basis
    fit: Fit
    choice: ModelChoice | None = None
    notes: tuple[str, ...] = ()

    @property
    def modes(self) -> Modes:
        """The modes themselves."""
        return self.basis.modes

    def error(self, kind: ErrorKind) -> float:
        """Error that a tolerance limits, length unit."""
        errors = self.fit.errors
        if kind == ErrorKind.MAX:
            return float(errors.max.max())
        return root_mean_square(errors.rms if kind == ErrorKind.RMS else errors.weighted_rms)


def fit_model(
    fitter: Fitter, basis: Basis, *, normal: tuple[float, float, float] | None = None
) -> Model:
    """Fit modes to a sequence, their paths limited to harmonics and to a plane on request.

    Parameters
    ----------
    fitter : Fitter
    basis : Basis
        The modes, factored.
    normal : tuple of float, optional
        Direction that is left out of all amplitudes, which must be along x, y, z.

    Raises
    ------
    ParameterError
        If the frames tell fewer harmonics apart than requested.
    """
    fit = fitter.fit(basis)
    model = Model(basis, fit)
    amplitudes, harmonics = fit.amplitudes, fitter.parameters.harmonics
    if harmonics is not None:
        functions = harmonics_of(fitter.sequence.n_frames, fitter.sequence.times)
        require_harmonics(harmonics, functions)
        amplitudes = functions.limited(amplitudes, harmonics)
    if normal is not None:
        n = np.array(normal)
        amplitudes = amplitudes - (amplitudes @ n)[:, :, None] * n
    if amplitudes is fit.amplitudes:
        return model
    return remeasured(fitter, model, amplitudes)


def remeasured(fitter: Fitter, model: Model, amplitudes: NDArray[np.float64]) -> Model:
    """Give a model other amplitudes, with the errors that they leave."""
    errors = measured(
        fitter.sequence,
        fitter.template,
        fitter.superposition(model.basis.shapes),
        amplitudes,
        model.fit.rotations,
        model.fit.translations,
    )
    return replace(model, fit=replace(model.fit, amplitudes=amplitudes, errors=errors))


def static_model(fitter: Fitter, basis: Basis, static: LinearMotion) -> Model:
    """Model in which nothing moves: zeros, and the motion that is left out as its error."""
    fit = replace(
        fitter.fit(basis),
        rotations=Rotations.none(fitter.sequence.n_frames),
        translations=static.shifts,
    )
    return remeasured(fitter, Model(basis, fit), np.zeros_like(fit.amplitudes))


def closure_gap(amplitudes: NDArray[np.float64]) -> float:
    """Distance of the last frame's amplitudes from the first's, over the usual step.

    Near 1 for one turn of a cycle whose next frame would be the first, 0 where the last
    frame repeats the first, large for a movement that does not come back; 0 without motion.
    """
    largest = float(np.abs(amplitudes).max(initial=0.0))
    if len(amplitudes) < 2 or largest == 0.0:
        return 0.0
    a = amplitudes / largest
    usual = root_mean_square(np.linalg.norm(np.diff(a, axis=0), axis=(1, 2)))
    return float(np.linalg.norm(a[-1] - a[0])) / usual if usual > 0 else 0.0
