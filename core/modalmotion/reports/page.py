"""A report in one step, its page for people (extra ``plot``), and its files."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from textwrap import fill, shorten
from typing import TYPE_CHECKING, Final

import numpy as np

from modalmotion import clinical, mesh, tracking
from modalmotion.classification import Model, classify, load_model, shipped_for
from modalmotion.clinical.strain import DEFINITIONS, DYSSYNCHRONY
from modalmotion.exports.reading import read
from modalmotion.exports.tables import frame_table
from modalmotion.formats.volumes.reading import holds_images
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm import Norm
from modalmotion.pictures.readouts import (
    draw_bulls_eye,
    draw_strain,
    draw_volume,
    mark_moments,
)
from modalmotion.pictures.views import apex_down, new_figure, round_length
from modalmotion.reports.content import OWN, Report, moments_of, quantities_of, report_of
from modalmotion.reports.fhir import fhir_json
from modalmotion.representation import counted, probability, with_interval
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store.disk import write_atomic
from modalmotion.viewer.page import View, view_page

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INK: Final = "#22262c"
_SOFT: Final = "#7a828c"
_BLUE: Final = "#1f5fa8"
_A4: Final = (8.27, 11.69)

# Letters of a name in the title.
_LONGEST_NAME: Final = 52

_CAVITIES: Final = {
    "lv": "left ventricle",
    "rv": "right ventricle",
    "la": "left atrium",
    "ra": "right atrium",
}

# Letters that fit on a line of the page, and the most lines of caveats.
_LETTERS: Final = 124
_MOST_LINES: Final = 14

# Heights of a title, of a line and of where the origin begins, as shares of the page.
_TITLE: Final = 0.034
_LINE: Final = 0.0127
_ORIGIN: Final = 0.105


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
    figure = new_figure(*_A4, dpi=110, layout=None)
    title = shorten(report.name, _LONGEST_NAME, placeholder=" ...") or "Motion analysis"
    figure.text(0.07, 0.955, title, fontsize=18, color=_INK, weight="bold")
    facts, span, n_frames = report.sequence.facts, report.sequence.span, report.sequence.n_frames
    stated = [word for word in (facts.modality, _CAVITIES.get(str(facts.cavity))) if word]
    what = "Motion analysis, " if report.name else ""
    line = (
        f"{what}{report.issued:%Y-%m-%d %H:%M} UTC",
        f"recording {report.sequence_id[:12]}",
        *stated,
        f"{counted(n_frames, 'frame')}{'' if span is None else f' in {span:.3g} s'}",
    )
    figure.text(0.07, 0.935, " · ".join(line), fontsize=9, color=_SOFT)
    figure.text(0.93, 0.955, "preliminary", fontsize=11, color="#b5533c", ha="right")
    frames = moments_of(report)
    for k, (frame, name) in enumerate(frames):
        axes = figure.add_axes((0.05 + 0.30 * k, 0.70, 0.28, 0.21))
        _draw_surface(axes, report, frame)
        axes.set_title(name, fontsize=9.5, color=_INK)
    if report.ventricle is not None and report.ventricle.regions is not None:
        axes = figure.add_axes((0.67, 0.70, 0.27, 0.20))
        scale = draw_bulls_eye(axes, report.ventricle.regions, frames[-1][0], fontsize=6.5)
        title = "inward motion at end systole\n(% of the radius)"
        axes.set_title(title, fontsize=9, color=_INK)
        if not report.ventricle.regions.has_segments:
            words = "rings from the base to the apex;\nwhere the anterior wall is, is not stated"
            figure.text(0.805, 0.675, words, fontsize=7.5, color=_SOFT, ha="center")
        bar = figure.colorbar(scale, cax=figure.add_axes((0.95, 0.73, 0.008, 0.14)))
        bar.ax.tick_params(labelsize=6.5)
    readouts = report.readouts
    if readouts is not None:
        curve = readouts.stated
        strain = None if report.ventricle is None else report.ventricle.strain
        panels = [figure.add_axes((0.10, 0.475, 0.50 if strain is None else 0.22, 0.17))]
        scaled = curve.volumes * readouts.shown_in, curve.reach * readouts.shown_in
        at = draw_volume(panels[0], readouts, *scaled)
        if curve.fraction == clinical.Fraction.EJECTION_FRACTION:
            mark_moments(panels[0], at, curve.end_diastole, curve.end_systole)
        if strain is not None:
            panels.append(figure.add_axes((0.39, 0.475, 0.22, 0.17)))
            draw_strain(panels[1], strain, readouts.times)
        for axes in panels:
            axes.tick_params(labelsize=7.5)
            axes.xaxis.label.set_fontsize(8)
            axes.yaxis.label.set_fontsize(8)
    _write_quantities(figure, report)
    _write_words(figure, report)
    return figure


def _draw_surface(axes: Axes, report: Report, frame: int) -> None:
    from matplotlib.collections import PolyCollection

    sequence = report.sequence
    everything = sequence.vertices.reshape(-1, 3).astype(np.float64)
    centre = everything.mean(axis=0)
    size = float(np.abs(everything - centre).max()) or 1.0
    # The same view for both frames.
    view = apex_down((sequence.vertices[0] - centre) / size)
    points = (sequence.vertices[frame] - centre) / size @ view
    axes.set_aspect("equal")
    axes.axis("off")
    axes.set(xlim=(-1.02, 1.02), ylim=(-1.02, 1.02))
    faces = sequence.faces
    if not len(faces):
        axes.plot(points[:, 0], points[:, 2], ".-", ms=2, lw=0.8, color=_BLUE)
        return
    oriented = mesh.oriented_faces(faces, len(points))
    normals = mesh.face_normals(points, faces if oriented is None else oriented)
    lengths = np.linalg.norm(normals, axis=1)
    facing = np.abs(normals[:, 1]) / np.where(lengths > 0, lengths, 1.0)
    order = np.argsort(-points[faces].mean(axis=1)[:, 1])
    shade = 0.35 + 0.6 * facing[order]
    colours = np.stack([0.25 + 0.6 * shade, 0.40 + 0.5 * shade, 0.60 + 0.38 * shade], axis=1)
    shown, is_large = points[faces][order][:, :, [0, 2]], len(faces) > 2000
    colours = np.clip(colours, 0, 1)
    axes.add_collection(
        PolyCollection(shown, facecolors=colours, edgecolors="none", rasterized=is_large)
    )
    length = round_length(0.8 * size)
    axes.plot([-1.0, -1.0 + length / size], [-1.0, -1.0], color=_INK, lw=1.5)
    words = f"{length:g} {sequence.unit or 'units'}"
    axes.text(-1.0, -0.97, words, fontsize=7, va="bottom", color=_INK)


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
    answer = report.classification
    model = [] if answer is None else [f"model {answer.model} {answer.model_id}"]
    origin = (f"recording {report.sequence_id}", *model, f"report {report.digest}", report.versions)
    origin = (*origin, report.intended_use)
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
            f"{OWN[name.lower()]} ({name}): relative change of the {what}."
            for name, what in DEFINITIONS.items()
        ]
        if strain.dyssynchrony is not None:
            measured.append(f"{OWN['sdi']}: {DYSSYNCHRONY}.")
        measured.append(
            f"From frame {strain.end_diastole} (end diastole, largest volume) to frame "
            f"{strain.end_systole} (end systole, smallest volume), from the {strain.source}, "
            f"{strain.layer}; with 95\N{NO-BREAK SPACE}% intervals."
        )
    compared = [] if deviation is None else list(deviation.findings)
    return [
        ("Class of motion", said, _INK),
        ("Compared with own controls", compared, _INK),
        ("Definitions", measured, _SOFT),
        ("Caveats", list(report.caveats), _SOFT),
    ]


FILES: Final[dict[str, Callable[[Report, View], bytes]]] = {
    "report.pdf": lambda found, _: report_pdf(found),
    "report.fhir.json": lambda found, _: fhir_json(found),
    "frames.csv": lambda found, _: (
        frame_table(found.signature, found.readouts, found.ventricle).to_csv().encode()
    ),
    "view.html": lambda _, view: view_page([view]).encode(),
}
"""Its files by name, each made of the report and the page on which the surface moves."""


def report(
    recording: MeshSequence | tracking.Track | Path,
    path: Path,
    *,
    model: Model | str | None = None,
    norm: Norm | None = None,
    issued: datetime | None = None,
    parameters: SignatureParameters | None = None,
) -> Report:
    """Write a report of one recording: a page for people, and files for systems.

    Parameters
    ----------
    recording : MeshSequence, Track or Path
        Images in a file are tracked first.
    path : str or Path
        A folder, for report.pdf, report.fhir.json, frames.csv and view.html; or one file
        that ends with .pdf, .json, .csv or .html.
    model : Model or str, optional
        Adds a class: a model, or the name of an included one.
    norm : Norm, optional
        Of your own controls, to compare with.
    issued : datetime, optional
        Time of the result, now by default; the same time gives the same bytes.
    parameters : SignatureParameters, optional

    Returns
    -------
    Report

    Raises
    ------
    InputError
        If the recording cannot be read, tracked or fitted.
    """
    data, name = None, ""
    if isinstance(recording, Path):
        name = recording.name
        recording = tracking.track(recording) if holds_images(recording) else read(recording)
    if isinstance(recording, tracking.Track):
        data, recording = recording.data, recording.sequence
    answer = None
    if model is not None:
        named = shipped_for(model, recording.facts) if isinstance(model, str) else model
        answer = classify(recording, load_model(named) if isinstance(named, str) else named)
    found = report_of(
        modal_signature(recording, parameters),
        recording,
        issued=datetime.now(UTC) if issued is None else issued,
        classification=answer,
        deviation=None if norm is None else norm.deviation(recording),
    )
    found = replace(found, name=name)
    view = View(found.signature, found.sequence, classification=answer, data=data)
    write_report(found, path, view)
    return found


def write_report(found: Report, path: Path, view: View) -> list[Path]:
    """Write the files of a report to a folder, or one file by its name.

    Parameters
    ----------
    found : Report
    path : Path
    view : View
        Of the page on which the surface moves.

    Returns
    -------
    list of Path
        Of the files.
    """
    paths = {name: path for name in FILES if Path(name).suffix == path.suffix.lower()}
    if not paths:
        path.mkdir(parents=True, exist_ok=True)
        paths = {name: path / name for name in FILES}
    for name, file in paths.items():
        write_atomic(file, FILES[name](found, view))
    return [*paths.values()]
