"""A signature as a piece of static HTML, for notebooks: no script, nothing loaded."""

from __future__ import annotations

from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.numerals import counted, numeral
from modalmotion.pictures.trajectory import main_trajectories
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.mode_colours import mode_colour
from modalmotion.signature.plain_names import plain_name

# Limits: rows and curves, points of a curve, notes, and letters of a note.
_MOST_ROWS: Final = 7
_MOST_POINTS: Final = 160
_MOST_NOTES: Final = 4
_LONGEST_NOTE: Final = 400

_WIDTH: Final = 420
_HEIGHT: Final = 130


def to_html(signature: ModalSignature) -> str:
    """Write a signature as HTML: its modes in words, their amplitudes over time, error and caveats.

    Parameters
    ----------
    signature : ModalSignature

    Returns
    -------
    str
        At most 30 kB for any number of frames and modes; every text is escaped.
    """
    unit = escape(signature.unit or "length units")
    n = counted(signature.n_frames, "frame")
    motion = float(signature.motion_rms.max())
    order = np.argsort(-signature.deformation_spectrum, kind="stable")[:_MOST_ROWS]
    rows = []
    for mode in order.tolist():
        label = signature.modes.labels[mode]
        name = plain_name(signature.topology, label, signature.parameters.components)
        rms = numeral(float(signature.deformation_spectrum[mode]), of=motion)
        rows.append(
            f'<tr><td><span style="color:{mode_colour(label)}">■</span> {escape(name)}</td>'
            f"<td><code>{escape(str(label))}</code></td>"
            f'<td style="text-align:right">{rms}</td></tr>'
        )
    colours = [mode_colour(signature.modes.labels[mode]) for mode in order.tolist()]
    others = len(signature.modes) - len(order)
    more = f"<p>and {counted(others, 'mode')} with less</p>" if others else ""
    notes = "".join(
        f"<li>{escape(note[:_LONGEST_NOTE])}</li>" for note in signature.notes[:_MOST_NOTES]
    )
    return (
        f"<div><p><strong>Modal signature</strong>: {escape(signature.surface)}, {n} of "
        f"{counted(signature.n_vertices, 'vertex', 'vertices')}, {signature.n_amplitudes} "
        f"amplitudes per frame. Error {numeral(signature.rms_error, of=motion)} {unit} RMS, "
        f"at most {numeral(signature.max_error, of=motion)}, of {numeral(motion)} {unit} of "
        "motion.</p>"
        f"{_curves(main_trajectories(signature)[:, order], colours)}"
        f"<table><thead><tr><th>mode</th><th>label</th><th>RMS ({unit})</th></tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table>{more}"
        f"{f'<ul>{notes}</ul>' if notes else ''}</div>"
    )


def _curves(paths: NDArray[np.float64], colours: list[str]) -> str:
    """Draw the amplitudes of some modes over time, the first ones on top."""
    if len(paths) < 2 or not paths.size:
        return ""
    # Evenly spaced frames: a screen has no more columns.
    frames = np.unique(np.linspace(0, len(paths) - 1, _MOST_POINTS).astype(np.int64))
    shown = paths[frames]
    low, high = float(shown.min()), float(shown.max())
    # Divided first: a span of very large numbers overflows.
    size = max(abs(low), abs(high)) or 1.0
    span = (high / size - low / size) or 1.0
    x = 4 + (_WIDTH - 8) * frames / (len(paths) - 1)
    lines = []
    for rank in range(shown.shape[1])[::-1]:
        y = 4 + (_HEIGHT - 8) * (high / size - shown[:, rank] / size) / span
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        lines.append(
            f'<polyline fill="none" stroke="{colours[rank]}" stroke-width="1.6" points="{points}"/>'
        )
    return (
        f'<svg width="{_WIDTH}" height="{_HEIGHT}" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
        f'aria-label="Amplitudes over time">{"".join(lines)}</svg>'
    )
