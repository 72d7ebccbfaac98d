"""A fitted motion with its harmonics, error limit and reason for its number of modes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.mesh.alignment import Rotations
from modalmotion.mesh.sequence import MEAN, MM_PER_UNIT, MeshSequence, Reference
from modalmotion.modes import Modes
from modalmotion.numeric.products import product, root_mean_square
from modalmotion.representation import shown
from modalmotion.signature.basis import Basis
from modalmotion.signature.fit import Fit
from modalmotion.signature.fitter import Fitter, LinearMotion, Scene, SceneError, SceneKind
from modalmotion.signature.parameters import USUAL_MODES, ErrorKind, SignatureParameters
from modalmotion.signature.superposition import measured

MOST_HARMONICS: Final = 64
"""Largest number of harmonics; a path that needs more is given as its frames."""

# Uneven times tell harmonics apart up to this condition.
_LARGEST_CONDITION: Final = 1e3


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Orthonormal functions of the frames, the slow ones first.

    A constant and a straight line in time, then cosine and sine of each harmonic: least
    squares on the times as they are, even or not. The line takes up the distance between the
    ends of a movement that does not come back, so that no cycle is closed by force.

    Parameters
    ----------
    functions : (frames, functions) float64
        Orthonormal columns.
    """

    functions: NDArray[np.float64]

    @property
    def most(self) -> int:
        """Largest number of harmonics."""
        return max(int(self.functions.shape[1]) - 2, 0) // 2

    def limited(self, amplitudes: NDArray[np.float64], harmonics: int) -> NDArray[np.float64]:
        """Limit paths over time to so many harmonics.

        Parameters
        ----------
        amplitudes : (frames, modes, 3) float64
        harmonics : int

        Returns
        -------
        (frames, modes, 3) float64
        """
        T = np.ascontiguousarray(self.functions[:, : n_functions(harmonics)])
        flat = np.ascontiguousarray(amplitudes.reshape(len(amplitudes), -1))
        return product(T, product(np.ascontiguousarray(T.T), flat)).reshape(amplitudes.shape)


def n_functions(harmonics: int) -> int:
    """Count the numbers of each amplitude's path: the line's two besides the harmonics'."""
    return 2 * harmonics + 2


def harmonics_of(n_frames: int, times: NDArray[np.float64] | None) -> Harmonics:
    """Make the functions of time of a sequence, as many as its frames tell apart.

    Parameters
    ----------
    n_frames : int
    times : (frames,) float64, s, or None
        Even steps if there are none. One turn of a cycle is one even step longer.
    """
    at = np.arange(n_frames, dtype=np.float64) if times is None else times - times[0]
    if n_frames == 1:
        return Harmonics(np.ones((1, 1)))
    x = at / (at[-1] * n_frames / (n_frames - 1))
    columns = [np.ones(n_frames), x - x.mean()]
    for p in range(1, MOST_HARMONICS + 1):
        if len(columns) + 2 > n_frames:
            break
        pair = [np.cos(2 * np.pi * p * x), np.sin(2 * np.pi * p * x)]
        if np.linalg.cond(np.stack([*columns, *pair], axis=1)) > _LARGEST_CONDITION:
            break
        columns += pair
    functions, R = np.linalg.qr(np.stack(columns, axis=1))
    return Harmonics(functions * np.where(np.diag(R) < 0, -1.0, 1.0))


def require_harmonics(harmonics: int, available: Harmonics) -> None:
    """Refuse more harmonics than the frames tell apart.

    Raises
    ------
    ParameterError
    """
    if harmonics > available.most:
        raise ParameterError(
            f"{harmonics} harmonics cannot be told apart in {len(available.functions)} frames.",
            remedy=f"Ask for at most {available.most}, or leave the path over time as it is.",
            details={"harmonics": harmonics, "most": available.most},
        )


WIDE: Final = 1.5
"""Ends of the range that differ by more say that motion and noise cannot be told apart well."""


@shown("sigma", "lowest", "highest", "between_frames", "between_neighbours")
@dataclass(frozen=True)
class Noise:
    """Noise of each coordinate of each vertex in each frame.

    Parameters
    ----------
    sigma : float, length unit
        Standard deviation, `rounding` at least.
    lowest, highest : float, length unit
        Range of the standard deviation; no highest where nothing bounds it: one frame.
    between_frames : float
        Correlation of a vertex's noise in one frame with that in the next.
    between_neighbours : float
        Correlation of the noise of two neighbours in one frame.
    independent_vertices : float
        Vertices of independent noise that average like these.
    mixed : int
        Times that independent noise is to be averaged over neighbours to be as smooth.
    rounding : float, length unit
        Noise from storing the coordinates in their type.
    modes : int
        Spatial modes that were told apart.
    """

    sigma: float
    lowest: float
    highest: float | None
    between_frames: float
    between_neighbours: float
    independent_vertices: float
    mixed: int
    rounding: float
    modes: int

    def note(self, unit: str | None) -> str:
        """Describe the estimate and what it rests on."""
        unit = unit or "length units"
        size = f"{self.sigma:.3g} {unit}"
        if self.highest is None:
            return f"One frame is too few to estimate noise; {size} was assumed."
        if self.sigma <= self.rounding:
            return (
                f"The noise is that of the stored numbers, {size} a coordinate; no other shows, so "
                "modes are added until they describe rounding. Ask by tolerance for fewer."
            )
        text = (
            f"The noise was estimated at {size} a coordinate (standard deviation; between "
            f"{self.lowest:.3g} and {self.highest:.3g} {unit}), with correlations of "
            f"{self.between_neighbours:.2f} between neighbours and {self.between_frames:.2f} "
            f"between frames, from {self.modes} modes and what they leave."
        )
        if self.highest > WIDE * self.lowest:
            text += " Motion and noise are hard to tell apart here."
        return text

    def displacement_rms(self, n_frames: int, reference: Reference, n_directions: int = 3) -> float:
        """RMS displacement that noise alone makes, the reference's own included, length unit."""
        return self.sigma * float(np.sqrt(n_directions * self.spread(n_frames, reference)))

    def spread(self, n_frames: int, reference: Reference) -> float:
        """Mean square of a coordinate's displacement by noise of variance 1."""
        correlations = over_time(self.between_frames, n_frames)
        if reference == MEAN:
            return 1.0 - float(correlations.mean())
        return 2.0 * (1.0 - float(correlations[reference].mean()))


def over_time(correlation: float, n_frames: int) -> NDArray[np.float64]:
    """Correlations of the noise of any two frames, (frames, frames) float64."""
    lags = np.abs(np.subtract.outer(np.arange(n_frames), np.arange(n_frames)))
    result: NDArray[np.float64] = np.float64(correlation) ** lags
    return result


COMPACT: Final = 10
"""Coordinates for each amplitude of a frame, from which a signature is called compact."""


def note_on_compactness(n_modes: int, n_vertices: int) -> tuple[str, ...]:
    """Say that so many modes are no longer compact, if they are more than the usual number."""
    if n_modes <= USUAL_MODES or n_modes * COMPACT <= n_vertices:
        return ()
    return (
        (
            f"{n_modes} modes of {n_vertices} vertices are no longer compact: "
            f"{n_vertices / n_modes:.1f} coordinates for each amplitude of a frame."
        ),
    )


@shown("asked", "limit", "limit_of", "scene", "noise.sigma")
@dataclass(frozen=True)
class ModelChoice:
    """Reason for the modes of a signature.

    Parameters
    ----------
    asked : str
        "tolerance" or "auto".
    limit : float, length unit
        The error limit; for "auto" the weighted RMS error that noise alone would leave.
    limit_of : ErrorKind
    noise : Noise or None
        The estimate, for "auto".
    scene : SceneKind
        The simplest kind of motion that holds the limit.
    errors : dict of SceneKind to SceneError
        Error of each kind.
    normal : tuple of float or None
        Unit normal of the plane that a planar motion was limited to.
    """

    asked: str
    limit: float
    limit_of: ErrorKind
    noise: Noise | None
    scene: SceneKind
    errors: dict[SceneKind, SceneError]
    normal: tuple[float, float, float] | None

    def as_json(self) -> dict[str, Any]:
        """Plain values, for files and answers."""
        return asdict(self)

    @staticmethod
    def from_json(values: dict[str, Any]) -> ModelChoice:
        """Read the output of `as_json`, after a round trip through JSON."""
        noise, normal = values["noise"], values["normal"]
        return ModelChoice(
            asked=values["asked"],
            limit=values["limit"],
            limit_of=ErrorKind(values["limit_of"]),
            noise=None if noise is None else Noise(**noise),
            scene=SceneKind(values["scene"]),
            errors={SceneKind(k): SceneError(**e) for k, e in values["errors"].items()},
            normal=None if normal is None else (normal[0], normal[1], normal[2]),
        )


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


# Pure noise exceeds its expected mean square by this many standard deviations at most, and
# its estimate is right to this share.
_DEVIATIONS = 3.0
_ESTIMATE = 0.03


def limit_of(parameters: SignatureParameters, sequence: MeshSequence) -> float:
    """Error that parameters with a tolerance allow.

    Parameters
    ----------
    parameters : SignatureParameters
    sequence : MeshSequence

    Returns
    -------
    float, length unit of the sequence

    Raises
    ------
    ParameterError
        If the tolerance is in mm and the unit of the sequence is unknown.
    """
    require_unit(parameters, sequence)
    return (parameters.tolerance or 0.0) / MM_PER_UNIT[sequence.unit or "mm"]


def require_unit(parameters: SignatureParameters, sequence: MeshSequence) -> None:
    """Refuse a tolerance in mm on numbers that are in an unknown unit.

    Raises
    ------
    ParameterError
    """
    if parameters.tolerance is not None and sequence.unit is None:
        raise ParameterError(
            f"A tolerance of {parameters.tolerance:g} mm was requested, but the length unit of the "
            "sequence is unknown.",
            remedy="Set the unit: m, cm, mm, um or nm.",
        )


def error_of(error: SceneError, kind: ErrorKind) -> float:
    """Error that a tolerance limits."""
    return float(getattr(error, kind.value))


def holds_noise(error: float, noise: Noise, fitter: Fitter, n_directions: int = 3) -> bool:
    """Whether a weighted RMS error is as small as that of noise alone."""
    n_frames, reference = fitter.sequence.n_frames, fitter.parameters.reference
    expected = noise.displacement_rms(n_frames, reference, n_directions)
    # The reference's part of the noise is drawn once for all frames.
    spread = float(np.sqrt(2.0 / (n_directions * noise.independent_vertices)))
    # Not squared: the square of very large coordinates would overflow.
    return error <= expected * float(np.sqrt(1.0 + _ESTIMATE + _DEVIATIONS * spread))


def simplest(scene: Scene, limit: float, kind: ErrorKind) -> SceneKind:
    """Simplest kind of motion that holds a limit."""
    for name, error in scene.errors.items():
        if error_of(error, kind) <= limit:
            return name
    return SceneKind.DEFORMABLE


def simplest_with_noise(scene: Scene, noise: Noise, fitter: Fitter) -> SceneKind:
    """Simplest kind of motion whose residual looks like noise."""
    for name, error in scene.errors.items():
        n_directions = 1 if name == SceneKind.PLANAR else 3
        if holds_noise(error.weighted_rms, noise, fitter, n_directions):
            return name
    return SceneKind.DEFORMABLE
