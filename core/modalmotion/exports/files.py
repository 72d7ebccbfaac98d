"""Values as files and pictures, in the format of the name's suffix or in a notebook, and back."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion import clinical, codec, errors, formats, store, tracking
from modalmotion.arguments.checking import Plotted
from modalmotion.classification import Classification, Evaluation, Model, ModelCard
from modalmotion.clinical import ventricle
from modalmotion.clinical.strain import Strain
from modalmotion.exports.reading import PICTURES, picture_bytes, read, write_picture
from modalmotion.exports.tables import amplitude_table
from modalmotion.formats import detect, glb_writing
from modalmotion.hdf5 import image, sealed
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm import Norm, norm_from_hdf5, norm_to_hdf5
from modalmotion.pictures import modes, readouts
from modalmotion.pictures.classification import answer_figure, card_figure, evaluation_figure
from modalmotion.pictures.signature import (
    amplitudes_figure,
    main_trajectories,
    signature_figure,
    tradeoff_figure,
)
from modalmotion.pictures.track import data_figure, deviations_figure, usual_frame
from modalmotion.representation import Floats, counted, numeral, with_article
from modalmotion.signature import Tradeoff, making
from modalmotion.signature.mode_names import mode_colour, mode_name
from modalmotion.template import Template

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot(value: Any, path: str | Path | None = None) -> Figure:
    """Draw a value.

    Parameters
    ----------
    value : object
        A sequence (with the superposition of its first 7 modes), a signature, read-outs, a strain,
        a track, a class, a model, its card or its test, a trade-off or a template; or the file of
        one.
    path : str or Path, optional
        File to write as well: .png, .svg or .pdf.

    Returns
    -------
    matplotlib.figure.Figure
        Notebooks show it.

    Raises
    ------
    ParameterError
        If the value has no picture.
    """
    figure = _drawn(value)
    if path is not None:
        write_picture(figure, Path(path))
    # For notebooks, which display only figures of pyplot.
    figure._repr_png_ = lambda: picture_bytes(figure, "png")  # type: ignore[attr-defined]
    return figure


def _drawn(value: Any) -> Figure:
    match value:
        case str() | Path():
            return _drawn(load(value))
        case MeshSequence():
            return signature_figure(value, making.modal_signature(value))
        case making.ModalSignature():
            return amplitudes_figure(value)
        case tracking.Track():
            has_data = value.data is not None
            return data_figure(value) if has_data else deviations_figure(value, usual_frame(value))
        case clinical.ClinicalReadouts():
            return readouts.volume_figure(value)
        case ventricle.VentricleReadouts() if value.regions is not None:
            return readouts.bulls_eye_figure(value.regions)
        case Strain():
            return readouts.strain_figure(value)
        case Classification():
            return answer_figure(value)
        case Model():
            return card_figure(value.card, value.name)
        case ModelCard():
            return card_figure(value, "model")
        case Evaluation():
            return evaluation_figure(value)
        case Tradeoff():
            return tradeoff_figure(value)
        case Template():
            return modes.template_figure(value)
    raise errors.ParameterError(
        f"There is no picture of {with_article(type(value).__name__)}.",
        remedy="Give a sequence (read(path)), or a result: a signature, read-outs, strain, a "
        "track, a class, a model, a trade-off.",
    )


# Limits: rows and curves, points of a curve, notes, and letters of a note.
_MOST_ROWS: Final = 7
_MOST_POINTS: Final = 160
_MOST_NOTES: Final = 4
_LONGEST_NOTE: Final = 400

_WIDTH: Final = 420
_HEIGHT: Final = 130


def to_html(signature: making.ModalSignature) -> str:
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
    rows, colours = [], []
    for mode in order.tolist():
        label = signature.modes.labels[mode]
        name = escape(mode_name(signature, label))
        rms = numeral(float(signature.deformation_spectrum[mode]), of=motion)
        colours.append(mode_colour(label))
        rows.append(
            f'<tr><td><span style="color:{colours[-1]}">■</span> {name}</td>'
            f"<td><code>{escape(str(label))}</code></td>"
            f'<td style="text-align:right">{rms}</td></tr>'
        )
    others = len(signature.modes) - len(order)
    more = f"<p>and {counted(others, 'mode')} with less</p>" if others else ""
    notes = "".join(
        f"<li>{escape(note.text[:_LONGEST_NOTE])}</li>" for note in signature.notes[:_MOST_NOTES]
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


def _curves(paths: Floats, colours: list[str]) -> str:
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


def _page(sequence: MeshSequence) -> bytes:
    from modalmotion.viewer.page import View, view_page

    return view_page([View(making.modal_signature(sequence), sequence)]).encode()


SURFACES: Final[dict[str, Callable[[MeshSequence], bytes]]] = {
    ".npz": formats.write_npz,
    ".h5": store.sequence_to_hdf5,
    ".vtkhdf": formats.write_vtkhdf,
    ".glb": lambda sequence: formats.write_glb(glb_writing.frame_animation(sequence)),
    ".zip": formats.write_ply_zip,
    ".raw": formats.write_raw,
}
"""Suffixes of files of moving surfaces that can be written and read."""

_WRITERS: Final[tuple[tuple[type, dict[str, Callable[[Any], bytes]]], ...]] = (
    (MeshSequence, {**SURFACES, ".html": _page}),
    (tracking.Track, {".h5": store.track_to_hdf5}),
    (
        making.ModalSignature,
        {
            ".h5": store.signature_to_hdf5,
            ".csv": lambda value: amplitude_table(value).to_csv().encode(),
            ".html": lambda value: to_html(value).encode(),
        },
    ),
    (Model, {".h5": store.model_to_hdf5}),
    (Norm, {".h5": norm_to_hdf5}),
    (Template, {".h5": store.template_to_hdf5}),
    (Classification, {".h5": store.classification_to_hdf5}),
    (codec.Encoded, {".mms": lambda value: value.data}),
)

_READERS: Final[dict[str, Callable[[Path], Any]]] = {
    "sequence": store.sequence_from_hdf5,
    "track": store.track_from_hdf5,
    "signature": store.signature_from_hdf5,
    "model": store.model_from_hdf5,
    "norm": norm_from_hdf5,
    "template": store.template_from_hdf5,
    "classification": store.classification_from_hdf5,
}


def save(value: Any, path: str | Path) -> Path:
    """Write a value to a file, in the format of its suffix.

    Parameters
    ----------
    value : object
        A sequence (.npz, .h5, .vtkhdf, .glb, .zip of PLY, .raw, .html), a track (.h5, and as its
        sequence), a signature (.h5, .csv, .html), a model, a norm, a template or a class (.h5), a
        stream (.mms). What `plot` draws is also written as a picture: .png, .svg, .pdf.
    path : str or Path

    Returns
    -------
    Path

    Raises
    ------
    ParameterError
        If there is no such format for it.
    StoreError
        If it cannot be written.
    """
    path, suffix = Path(path), Path(path).suffix.lower()
    if suffix in PICTURES and isinstance(value, Plotted):
        value.plot(path)
        return path
    writers = next((of for kind, of in _WRITERS if isinstance(value, kind)), {})
    if suffix not in writers and isinstance(value, tracking.Track):
        return save(value.sequence, path)
    if suffix not in writers:
        known = [*writers, *(PICTURES if isinstance(value, Plotted) else ())]
        what = with_article(type(value).__name__)
        raise errors.ParameterError(
            f"{path.name!r} has no format for {what}.",
            remedy=f"End the name with {', '.join(known)}."
            if known
            else "Give a sequence, a track, a signature, a model, a class or a stream.",
        )
    store.write_atomic(path, writers[suffix](value))
    return path


def load(path: str | Path) -> Any:
    """Read back what `save` wrote: any result, or a moving surface in any format.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    MeshSequence, Track, ModalSignature, Model, Norm, Template or Classification
        For a stream, the decoded sequence.

    Raises
    ------
    NotFoundError
        If there is no such file.
    InputError, StoreError
        If it cannot be read.
    """
    path = Path(path)
    if not path.exists() and not set(path.name) & set("*?["):
        raise errors.NotFoundError(f"There is no file '{path}'.", remedy="Check the path.")
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(len(sealed.SIGNATURE))
        if head.startswith(detect.STREAM):
            return codec.decode(path.read_bytes())
        if head == sealed.SIGNATURE:
            # HDF5 of other programs has no form.
            kind = ""
            with suppress(errors.StoreError):
                kind = image.form_of(path).kind
            if kind in _READERS:
                return _READERS[kind](path)
    return read(path)
