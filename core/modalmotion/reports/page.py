"""A report on one page, for people. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

import io
from textwrap import fill, shorten
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical import ClinicalReadouts, Fraction
from modalmotion.clinical.segments import RegionalMotion
from modalmotion.clinical.strain import DEFINITIONS
from modalmotion.errors import needs_extra
from modalmotion.mesh import face_normals, oriented_faces
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.pictures.readouts import draw_strain, mark_moments
from modalmotion.reports.content import OWN, Report, moments_of, quantities_of
from modalmotion.representation import counted, probability, with_interval

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INK: Final = "#22262c"
_SOFT: Final = "#7a828c"
_BLUE: Final = "#1f5fa8"
_A4: Final = (8.27, 11.69)

# Letters of a name in the title.
_LONGEST_NAME: Final = 52

# Letters that fit on a line of the page, and the most lines of caveats.
_LETTERS: Final = 118
_MOST_LINES: Final = 14

# Heights of a title, of a line and of where the origin begins, as shares of the page.
_TITLE: Final = 0.034
_LINE: Final = 0.0127
_ORIGIN: Final = 0.105

# Rings of the bull's-eye from the base inward, and the first angle of each.
_RINGS: Final = ((6, 60.0), (6, 60.0), (4, 45.0), (1, 0.0))

Array = NDArray[np.float64]


def report_pdf(report: Report) -> bytes:
    """Write the page as PDF, the same bytes for the same report."""
    figure = report_figure(report)
    file = io.BytesIO()
    about = {
        "Title": "Motion analysis",
        "Creator": "modalmotion",
        "Producer": None,
        "CreationDate": report.issued,
    }
    figure.savefig(file, format="pdf", metadata=about)
    return file.getvalue()


def report_figure(report: Report) -> Figure:
    """Draw the page: surfaces, volume, regions, quantities, class, caveats, origin.

    Parameters
    ----------
    report : Report

    Returns
    -------
    matplotlib.figure.Figure
    """
    with needs_extra("plot"):
        from matplotlib.figure import Figure

    figure = Figure(figsize=_A4, dpi=110)
    title = shorten(report.name, _LONGEST_NAME, placeholder=" ...") or "Motion analysis"
    figure.text(0.07, 0.955, title, fontsize=18, color=_INK, weight="bold")
    facts = report.sequence.facts
    stated = [word for word in (facts.modality, _cavity(str(facts.cavity))) if word]
    figure.text(
        0.07,
        0.935,
        " · ".join(
            [
                f"Motion analysis, {report.issued:%Y-%m-%d %H:%M} UTC",
                f"recording {report.sequence_id[:12]}",
                *stated,
                _duration(report.sequence),
            ]
        ),
        fontsize=9,
        color=_SOFT,
    )
    figure.text(0.93, 0.955, "preliminary", fontsize=11, color="#b5533c", ha="right")
    frames = moments_of(report)
    for k, (frame, name) in enumerate(frames):
        axes = figure.add_axes((0.05 + 0.30 * k, 0.70, 0.28, 0.21))
        _draw_surface(axes, report, frame)
        axes.set_title(name, fontsize=9.5, color=_INK)
    if report.ventricle is not None and report.ventricle.regions is not None:
        axes = figure.add_axes((0.67, 0.70, 0.27, 0.20), projection="polar")
        _draw_regions(figure, axes, report.ventricle.regions, frames[-1][0])
    if report.readouts is not None:
        strain = None if report.ventricle is None else report.ventricle.strain
        wide = 0.50 if strain is None else 0.22
        _draw_volume(figure.add_axes((0.10, 0.475, wide, 0.17)), report.readouts)
        if strain is not None:
            draw_strain(figure.add_axes((0.39, 0.475, 0.22, 0.17)), strain, report.readouts.times)
    _write_quantities(figure, report)
    _write_words(figure, report)
    return figure


def _duration(sequence: MeshSequence) -> str:
    frames = counted(sequence.n_frames, "frame")
    return frames if sequence.span is None else f"{frames} in {sequence.span:.3g} s"


def _cavity(name: str) -> str:
    words = {"lv": "left ventricle", "rv": "right ventricle", "la": "left atrium"}
    return {**words, "ra": "right atrium"}.get(name, "")


def _draw_surface(axes: Axes, report: Report, frame: int) -> None:
    from matplotlib.collections import PolyCollection

    sequence = report.sequence
    everything = sequence.vertices.reshape(-1, 3).astype(np.float64)
    centre = everything.mean(axis=0)
    size = float(np.abs(everything - centre).max()) or 1.0
    # The longest axis upright, the same view for both frames.
    _, _, (third, second, first) = np.linalg.svd(
        (sequence.vertices[0] - centre) / size, full_matrices=False
    )
    view = np.stack([second, first, third], axis=1)
    points = (sequence.vertices[frame] - centre) / size @ view
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set(xlim=(-1.02, 1.02), ylim=(-1.02, 1.02))
    faces = sequence.faces
    if not len(faces):
        axes.plot(points[:, 0], points[:, 2], ".-", ms=2, lw=0.8, color=_BLUE)
        return
    oriented = oriented_faces(faces, len(points))
    normals = face_normals(points, faces if oriented is None else oriented)
    lengths = np.linalg.norm(normals, axis=1)
    facing = np.abs(normals[:, 1]) / np.where(lengths > 0, lengths, 1.0)
    order = np.argsort(-points[faces].mean(axis=1)[:, 1])
    shade = 0.35 + 0.6 * facing[order]
    colours = np.stack([0.25 + 0.6 * shade, 0.40 + 0.5 * shade, 0.60 + 0.38 * shade], axis=1)
    axes.add_collection(
        PolyCollection(
            points[faces][order][:, :, [0, 2]],
            facecolors=np.clip(colours, 0, 1),
            edgecolors="none",
            rasterized=len(faces) > 2000,
        )
    )
    _scale_bar(axes, size, sequence.unit)


def _scale_bar(axes: Axes, size: float, unit: str | None) -> None:
    length = 10.0 ** np.floor(np.log10(size))
    while length < 0.4 * size:
        length *= 2.0
    share = length / size
    axes.plot([-1.0, -1.0 + share], [-1.0, -1.0], color=_INK, lw=1.5)
    axes.text(-1.0, -0.97, f"{length:g} {unit or 'units'}", fontsize=7, va="bottom", color=_INK)


def _draw_regions(figure: Figure, axes: Any, regions: RegionalMotion, frame: int) -> None:
    shares = regions.shares[frame]
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    scale = Normalize(min(0.0, float(np.nanmin(shares))), max(1.0, float(np.nanmax(shares))))
    colours = colormaps["viridis"]
    # If the anterior wall is unknown there are rings only.
    rings = _RINGS if regions.has_segments else tuple((1, 0.0) for _ in shares)
    k, n_rings = 0, len(rings)
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for ring, (n, start) in enumerate(rings):
        outer = 1.0 - ring / n_rings
        width = 2.0 * np.pi / n
        axes.plot(turn, np.full(len(turn), outer), color="white", lw=0.8, zorder=3)
        for j in range(n):
            value = float(shares[k])
            middle = np.deg2rad(start) + np.pi / 2 - np.deg2rad(30.0 * (n == 6)) + j * width
            colour = "#dddddd" if np.isnan(value) else colours(scale(value))
            axes.bar(
                middle,
                1.0 / n_rings,
                width=width,
                bottom=outer - 1.0 / n_rings,
                color=colour,
                edgecolor="none" if n == 1 else "white",
                lw=0.8,
            )
            if not np.isnan(value):
                radius = 0.0 if n == 1 and ring == n_rings - 1 else outer - 0.5 / n_rings
                dark = scale(value) < 0.6
                axes.text(
                    middle,
                    radius,
                    f"{value:.0f}",
                    ha="center",
                    va="center",
                    fontsize=6.5,
                    color="white" if dark else _INK,
                )
            k += 1
    axes.set(xticks=[], yticks=[], ylim=(0, 1))
    axes.spines["polar"].set_visible(False)
    axes.set_title("inward motion at end systole, % of the radius", fontsize=9, color=_INK)
    bar = figure.add_axes((0.95, 0.73, 0.008, 0.14))
    figure.colorbar(ScalarMappable(scale, colours), cax=bar).ax.tick_params(labelsize=6.5)


def _draw_volume(axes: Axes, readouts: ClinicalReadouts) -> None:
    times = readouts.times
    v = readouts.stated.volumes * readouts.shown_in
    b = readouts.stated.reach * readouts.shown_in
    at = np.arange(len(v)) if times is None else times
    axes.fill_between(at, v - b, v + b, color=_BLUE, alpha=0.22, lw=0)
    axes.plot(at, v, "o-", ms=2.5, lw=1.2, color=_BLUE)
    if readouts.stated.fraction == Fraction.EJECTION_FRACTION:
        mark_moments(axes, at, readouts.stated.end_diastole, readouts.stated.end_systole)
    axes.set_xlabel("frame" if times is None else "time (s)", fontsize=8)
    axes.set_ylabel(f"volume ({readouts.volume_unit})", fontsize=8)
    axes.tick_params(labelsize=7.5)
    axes.grid(alpha=0.25)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _write_quantities(figure: Figure, report: Report) -> None:
    y = 0.642
    for one in quantities_of(report):
        figure.text(0.66, y, OWN[one.name], fontsize=8.5, color=_SOFT)
        value, ends = with_interval(one.value, one.low, one.high)
        figure.text(0.66, y - 0.0145, f"{value} {one.unit}", fontsize=11, color=_INK)
        figure.text(0.94, y - 0.0145, ends, fontsize=9, color=_SOFT, ha="right")
        y -= 0.0295


def _write_words(figure: Figure, report: Report) -> None:
    y = 0.425
    for title, lines, colour in _sections(report):
        if not lines:
            continue
        figure.text(0.07, y, title, fontsize=10.5, color=_INK, weight="bold", va="top")
        filled = "\n".join(fill(line, _LETTERS) for line in lines).splitlines()
        most = min(_MOST_LINES, max(1, int((y - 0.018 - _ORIGIN) / _LINE)))
        if len(filled) > most:
            filled = [*filled[: most - 1], "… the rest is in the other files of this report"]
        figure.text(0.07, y - 0.018, "\n".join(filled), fontsize=8, color=colour, va="top")
        y -= _TITLE + _LINE * len(filled)
    signature = report.signature
    versions = ", ".join(f"{name} {value}" for name, value in signature.provenance.items())
    origin = [
        f"recording {report.sequence_id}",
        f"report {report.digest}",
        versions,
        report.intended_use,
    ]
    if report.classification is not None:
        origin.insert(1, f"model {report.classification.model} {report.classification.model_id}")
    text = "\n".join(fill(line, 132) for line in origin)
    figure.text(0.07, 0.03, text, fontsize=6.5, color=_SOFT, va="bottom")


def _sections(report: Report) -> list[tuple[str, list[str], str]]:
    answer, deviation = report.classification, report.deviation
    said: list[str] = []
    if answer is not None and answer.label is None:
        said = [f"No class: {'; '.join(answer.flags) or 'inconclusive'}."]
    elif answer is not None:
        others = [name for name in answer.class_set if name != answer.label]
        sure = probability(answer.probability)
        said = [
            f"{answer.label}, probability {sure} (model {answer.model}).",
            f"Not excluded at {100 * answer.coverage:.0f} %: {', '.join(others)}."
            if others
            else f"No other class remains at {100 * answer.coverage:.0f} %.",
        ]
    strain = None if report.ventricle is None else report.ventricle.strain
    measured: list[str] = []
    if report.readouts is not None and report.readouts.stated.ejection_fraction is not None:
        measured.append(
            "Ejection fraction: stroke volume over end-diastolic volume. End diastole and end "
            "systole are the frames of the largest and the smallest volume."
        )
    if strain is not None:
        measured += [
            f"{name}: relative change of the {what}." for name, what in DEFINITIONS.items()
        ]
        measured.append(
            f"From frame {strain.end_diastole} (end diastole, largest volume) to frame "
            f"{strain.end_systole} (end systole, smallest volume), from {strain.source}, "
            f"{strain.layer}; with 95 % intervals."
        )
    compared: list[str] = []
    if deviation is not None:
        compared = list(deviation.findings)
    return [
        ("Class of motion", said, _INK),
        ("Compared with own controls", compared, _INK),
        ("Definitions", measured, _SOFT),
        ("Caveats", list(report.caveats), _SOFT),
    ]
