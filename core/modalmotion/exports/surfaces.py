"""Surfaces superposed from a signature, as files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError
from modalmotion.exports.modal_animation import modal_animation
from modalmotion.formats import write_glb, write_npz, write_ply_zip, write_vtkhdf
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.scale import lengths
from modalmotion.signature.interpolation import at_times
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.signature.resampling import resample
from modalmotion.template import Template


class SurfaceFormat(StrEnum):
    """Formats that moving surfaces are written in."""

    NPZ = "npz"
    VTKHDF = "vtkhdf"
    GLB = "glb"
    PLY = "ply"


SUFFIXES = {
    ".npz": SurfaceFormat.NPZ,
    ".vtkhdf": SurfaceFormat.VTKHDF,
    ".glb": SurfaceFormat.GLB,
    ".zip": SurfaceFormat.PLY,
}
"""Format by suffix."""


def write_superposed(
    signature: ModalSignature,
    sequence: MeshSequence,
    surface_format: SurfaceFormat = SurfaceFormat.NPZ,
    *,
    template: Template | None = None,
    times: NDArray[np.float64] | None = None,
    phases: list[float] | int | None = None,
    max_targets: int | None = None,
) -> bytes:
    """Superpose a signature's modes on its reference, and write the surfaces.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from.
    surface_format : SurfaceFormat
        npz, VTKHDF (with the error at each vertex as a field; of phases the deviation), GLB (modes
        as morph targets, amplitudes as their weights), or a zip of PLY files.
    template : Template, optional
        The one that the signature's parameters name, if they name one.
    times : (n,) float64, s, optional
        Those of the frames by default.
    phases : list of float or int, optional
        Instead of times: shares of the cycle, or a number of even steps; see `resample`.
    max_targets : int, optional
        For a GLB: largest number of targets, those with most motion.

    Returns
    -------
    bytes

    Raises
    ------
    ParameterError
        If a time is outside the recording, the sequence is another, or both times and phases
        are chosen, or phases of a GLB.
    """
    if phases is not None and (times is not None or surface_format == SurfaceFormat.GLB):
        raise ParameterError(
            "Phases were given with times, or for a GLB, which has all frames.",
            remedy="Give one of times and phases, and another format for phases.",
        )
    moved = signature if times is None else at_times(signature, times)
    if surface_format == SurfaceFormat.GLB:
        return write_glb(modal_animation(moved, sequence, max_targets, template=template))
    positions = reconstruct(moved, sequence, template=template)
    surfaces = replace(sequence, vertices=positions, times=moved.times, uncertainty=None)
    fields = None
    if phases is not None:
        resampled = resample(surfaces, phases)
        surfaces, fields = resampled.sequence, {"deviation": resampled.deviations}
    elif times is None:
        fields = {"error": lengths(positions - sequence.vertices)}
    attributes: dict[str, str | int | float] = {
        "sequence_id": signature.sequence_id,
        "modes": len(signature.modes),
        **signature.provenance,
    }
    return write_surfaces(surfaces, surface_format, fields, attributes)


def write_surfaces(
    surfaces: MeshSequence,
    surface_format: SurfaceFormat,
    fields: Mapping[str, NDArray[np.float64]] | None = None,
    attributes: Mapping[str, str | int | float] | None = None,
) -> bytes:
    """Write surfaces frame by frame: npz, VTKHDF with fields and attributes, or a zip of PLY."""
    if surface_format == SurfaceFormat.PLY:
        return write_ply_zip(surfaces)
    if surface_format == SurfaceFormat.NPZ:
        return write_npz(surfaces)
    return write_vtkhdf(surfaces, fields, attributes)
