"""Panels of a picture: amplitudes over time, their spectrum, the error by frame."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numerals import numeral
from modalmotion.pictures.unit import ShownUnit
from modalmotion.signature.making import ModalSignature, SignatureKind
from modalmotion.signature.mode_colours import COLOURS, mode_colour, mode_dash
from modalmotion.signature.plain_names import plain_name

_MOST_COLOURED: Final = 6
_OTHERS: Final = "#b9bdc1"
_MOST_LABELS: Final = 24


def main_trajectories(signature: ModalSignature) -> NDArray[np.float64]:
    """Project each mode's amplitudes on the direction in which they vary most.

    Returns
    -------
    (frames, modes) float64, `unit`
        Signed so that the value farthest from zero is positive.
    """
    # A = U S V^T; the first row of V^T is the direction with the largest sum of squares.
    of_modes = signature.body_amplitudes.transpose(1, 0, 2)
    _, _, directions = np.linalg.svd(of_modes, full_matrices=False)
    trajectories: NDArray[np.float64] = np.einsum("mfd,md->fm", of_modes, directions[:, 0])
    farthest = np.take_along_axis(trajectories, np.abs(trajectories).argmax(axis=0)[None], axis=0)
    return np.where(farthest < 0.0, -trajectories, trajectories)


def draw_trajectories(axes: Any, signature: ModalSignature, shown: ShownUnit) -> None:
    """Draw amplitudes over time, the largest modes in colour."""
    at, label = _times(signature)
    trajectories, colours = main_trajectories(signature) / shown.size, _colours(signature)
    # The largest last, so that they are on top.
    for mode in np.argsort(signature.deformation_spectrum, kind="stable"):
        colour = colours[mode]
        is_named = colour != _OTHERS
        axes.plot(
            at,
            trajectories[:, mode],
            color=colour,
            ls=(0, mode_dash(signature.modes.labels[mode])) if is_named else "-",
            lw=1.8 if is_named else 0.8,
            marker=_marker(at),
        )
    axes.set_title("Amplitudes, each along its main direction", fontsize=10)
    axes.set(xlabel=label, ylabel=shown.name)
    axes.grid(alpha=0.25)


def draw_spectrum(axes: Any, signature: ModalSignature, shown: ShownUnit) -> None:
    """Draw the deformation spectrum, a bar for each mode in the order of the signature."""
    spectrum = signature.deformation_spectrum / shown.size
    places = np.arange(len(spectrum))
    axes.barh(places, spectrum, color=_colours(signature), height=0.75)
    axes.invert_yaxis()
    if len(spectrum) <= _MOST_LABELS:
        axes.set_yticks(places, _names(signature), fontsize=8)
    else:
        axes.set_ylabel("mode, by its place in the signature")
    axes.set_title("Deformation spectrum: RMS over frames", fontsize=10)
    axes.set_xlabel(shown.name)
    axes.grid(axis="x", alpha=0.25)


def draw_errors(axes: Any, signature: ModalSignature, shown: ShownUnit) -> None:
    """Draw the motion of the surface in each frame, and the error of the amplitudes."""
    at, label = _times(signature)
    marker = _marker(at)
    motion = signature.motion_rms / shown.size
    rms, largest = signature.rms_errors / shown.size, signature.max_errors / shown.size
    axes.fill_between(at, motion, color="#dfe3e8", lw=0)
    axes.plot(at, motion, color="#8a939c", label="motion, RMS", marker=marker)
    axes.plot(at, largest, "--", color=COLOURS[1], label="error, largest", marker=marker)
    axes.plot(at, rms, color=COLOURS[0], label="error, RMS", marker=marker)
    axes.set_title(
        f"Error of all frames {numeral(signature.rms_error / shown.size, 2)} RMS, "
        f"{numeral(signature.max_error / shown.size, 2)} at most",
        fontsize=10,
    )
    axes.set(xlabel=label, ylabel=shown.name)
    # There is space for the legend above the curves.
    axes.set_ylim(0.0, 1.18 * max(float(motion.max()), float(largest.max())) or 1.0)
    axes.grid(alpha=0.25)
    axes.legend(fontsize=8, frameon=False, ncols=3, loc="upper center", columnspacing=1.2)


def _colours(signature: ModalSignature) -> list[str]:
    """Assign a colour to each of the largest moving modes."""
    spectrum = signature.deformation_spectrum
    colours = [_OTHERS] * len(spectrum)
    for mode in np.argsort(-spectrum, kind="stable")[:_MOST_COLOURED].tolist():
        if spectrum[mode] > 0.0:
            colours[mode] = mode_colour(signature.modes.labels[mode])
    return colours


def _names(signature: ModalSignature) -> list[str]:
    """Describe each mode, once for a pair, with its label."""
    components = signature.parameters.components
    is_offset = signature.kind == SignatureKind.OFFSET
    names, before = [], ""
    for label in signature.modes.labels:
        name = plain_name(signature.topology, label, components, is_offset=is_offset)
        names.append(str(label) if name == before else f"{name}  {label}")
        before = name
    return names


def _times(signature: ModalSignature) -> tuple[NDArray[np.float64], str]:
    if signature.times is None:
        return np.arange(signature.n_frames, dtype=np.float64), "frame"
    return signature.times, "time (s)"


def _marker(at: NDArray[np.float64]) -> str | None:
    # One frame alone has no line.
    return "o" if len(at) == 1 else None
