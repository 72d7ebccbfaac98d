"""Cost and error of a signature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from modalmotion.choice.harmonics import n_functions
from modalmotion.choice.scene import SceneError
from modalmotion.mesh.sequence import MM_PER_UNIT
from modalmotion.representation import shown
from modalmotion.signature.value import ModalSignature


@shown("rms_error:unit", "max_error:unit", "amplitudes_per_frame", "bytes", "compression")
@dataclass(frozen=True)
class Price:
    """Cost and error of a description of a motion.

    Parameters
    ----------
    rms_error : float, mm
        Over all vertices and frames. All errors are in mm, or in the length unit where that is
        unknown.
    weighted_rms_error : float, mm
        Over the surface and all frames.
    p95_error : float, mm
        95th percentile over the vertices in the worst frame.
    max_error : float, mm
        Of any vertex in any frame.
    unit : str or None
        "mm", or None where the unit of the input is unknown.
    condition : float
        Factor of the data's precision that the amplitudes may lose.
    amplitudes_per_frame : int
    numbers : int
        Of the whole trajectory: amplitudes of all frames, or of all harmonics.
    bytes : int
        Of these numbers as float64, which is how they are stored.
    bytes_float32 : int
        Of these numbers as float32.
    compression : float
        Coordinates over amplitudes of one frame, as in Nastar 1994.
    compression_of_sequence : float
        Numbers in the sequence over those to keep: trajectory and reference.
    milliseconds : mapping of str to float
        By stage, where they were measured. Results do not store them.
    """

    rms_error: float
    weighted_rms_error: float
    p95_error: float
    max_error: float
    unit: str | None
    condition: float
    amplitudes_per_frame: int
    numbers: int
    bytes: int
    bytes_float32: int
    compression: float
    compression_of_sequence: float
    milliseconds: Mapping[str, float] = field(default_factory=dict)


def price_of(signature: ModalSignature, milliseconds: Mapping[str, float] | None = None) -> Price:
    """Give the price of a signature.

    Parameters
    ----------
    signature : ModalSignature
    milliseconds : mapping of str to float, optional
        Times measured during the fit.
    """
    modes, f = len(signature.modes), signature.n_frames
    harmonics = signature.parameters.harmonics
    per_path = f if harmonics is None else min(n_functions(harmonics), f)
    directions = signature.parameters.n_directions
    if signature.choice is not None and signature.choice.normal is not None:
        directions = 2
    return priced(
        SceneError(
            rms=signature.rms_error,
            weighted_rms=signature.weighted_rms_error,
            p95=float(signature.p95_errors.max()),
            max=signature.max_error,
        ),
        unit=signature.unit,
        condition=signature.condition,
        amplitudes_per_frame=directions * modes,
        numbers=directions * modes * per_path,
        n_frames=f,
        n_vertices=signature.n_vertices,
        milliseconds=milliseconds,
    )


def priced(
    errors: SceneError,
    *,
    unit: str | None,
    condition: float,
    amplitudes_per_frame: int,
    numbers: int,
    n_frames: int,
    n_vertices: int,
    milliseconds: Mapping[str, float] | None = None,
) -> Price:
    """Work out a price from counts and errors.

    Parameters
    ----------
    errors : SceneError
    unit : str or None
    condition : float
    amplitudes_per_frame, numbers, n_frames, n_vertices : int
    milliseconds : mapping of str to float, optional
    """
    factor = 1.0 if unit is None else MM_PER_UNIT[unit]
    coordinates = 3 * n_vertices
    return Price(
        rms_error=factor * errors.rms,
        weighted_rms_error=factor * errors.weighted_rms,
        p95_error=factor * errors.p95,
        max_error=factor * errors.max,
        unit=None if unit is None else "mm",
        condition=condition,
        amplitudes_per_frame=amplitudes_per_frame,
        numbers=numbers,
        bytes=8 * numbers,
        bytes_float32=4 * numbers,
        compression=coordinates / max(amplitudes_per_frame, 1),
        compression_of_sequence=n_frames * coordinates / (numbers + coordinates),
        milliseconds=dict(milliseconds or {}),
    )
