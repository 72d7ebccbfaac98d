"""A view as one HTML file that opens from disk and loads nothing, and as a widget in a notebook."""

import base64
import gzip
import hashlib
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.classification.answer import Classification
from modalmotion.errors import LimitError, ParameterError, needs_extra
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import Array, Bytes, Floats, with_interval
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.template import Template
from modalmotion.tracking.result import SampledData, Track
from modalmotion.viewer.container import read_container, write_container
from modalmotion.viewer.payload import frames_payload, single_scale, view_payload

# Camera of the viewer at its start, in radians about the axis and above the horizon.
_YAW: Final = 0.55
_PITCH: Final = 0.28

# Pixels along a side of the picture, and points of the surface that are drawn into it.
_SIDE: Final = 256
_POINTS: Final = 500_000
_DARKEST, _RANGE = 70.0, 150.0


def first_view(payloads: list[bytes]) -> str:
    """Write title, read-outs and a still picture of each view, as the script draws them later.

    Parameters
    ----------
    payloads : list of bytes
        From `view_payload`.

    Returns
    -------
    str
        HTML without script.
    """
    views = [read_container(payload) for payload in payloads]
    pictures = "".join(_picture(header, arrays) for header, arrays in views)
    cards = "".join(_card(header) for header, _ in views)
    header, _ = views[0]
    title = header["title"] or f"Recording {header['sequence_id'][:12]}"
    return (
        '<div class="viewer first"><header class="head"><div>'
        f'<h1>{escape(title)}</h1><p class="facts">{header["n_frames"]} frames</p></div></header>'
        f'<div class="work"><section class="left"><div class="stage still">{pictures}</div>'
        f'</section><aside class="right">{cards}</aside></div></div>'
    )


def _card(header: Mapping[str, Any]) -> str:
    """Write the largest figure, and the others in a table."""
    volume, strain = header["volume"], header["strain"]
    if "refused" in volume:
        reason = escape(volume["refused"])
        return f'<div class="card"><h2>Volume</h2><p class="note">{reason}</p></div>'
    big = ""
    if "share" in volume:
        value, ends = _words(volume["share"])
        big = f'<p class="big">{value} %<span> {ends} %</span></p>'
    rows = "".join(
        f'<tr><th scope="row">{figure["name"]}</th><td>{value} {figure["unit"]}</td>'
        f'<td class="soft">{ends}</td></tr>'
        for figure in (*volume["figures"], *strain.get("figures", ()))
        for value, ends in [_words(figure)]
    )
    name = volume["share"]["name"].capitalize() if "share" in volume else "Volume"
    return (
        f'<div class="card readouts"><h2>{name}</h2>{big}<table class="figures"><thead><tr>'
        f'<th></th><th></th><th scope="col">95 % interval</th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _words(figure: Mapping[str, Any]) -> tuple[str, str]:
    return with_interval(figure["value"], figure["low"], figure["high"])


def _picture(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> str:
    """Draw the reference surface from the side that the viewer shows first, as a PNG."""
    points, shades = _sampled(arrays["rest"].astype(np.float64), arrays["faces"])
    turned = points @ np.array(header["view"])
    towards = np.array(
        [np.sin(_YAW) * np.cos(_PITCH), -np.cos(_YAW) * np.cos(_PITCH), np.sin(_PITCH)]
    )
    right = np.array([np.cos(_YAW), np.sin(_YAW), 0.0])
    seen = turned @ np.stack([right, -np.cross(towards, right), towards], axis=1)
    shades = np.abs(shades @ np.array(header["view"]) @ towards)
    low, high = seen[:, :2].min(axis=0), seen[:, :2].max(axis=0)
    scale = 0.9 * _SIDE / (float((high - low).max()) or 1.0)
    column, row = ((seen[:, :2] - (low + high) / 2) * scale + _SIDE / 2).astype(np.intp).T
    pixels = np.zeros((_SIDE, _SIDE, 2), dtype=np.uint8)
    # The nearest is drawn last.
    order = np.argsort(seen[:, 2], kind="stable")
    grey = (_DARKEST + _RANGE * shades[order]).astype(np.uint8)
    pixels[row[order], column[order]] = np.stack([grey, np.full_like(grey, 255)], axis=1)
    text = base64.b64encode(_png(pixels)).decode()
    return f'<img alt="The surface at rest" decoding="sync" src="data:image/png;base64,{text}">'


def _sampled(vertices: Floats, faces: Array) -> tuple[Floats, Floats]:
    """Points evenly on a surface with the unit normals there; its vertices if it has no area."""
    corners = vertices[faces.astype(np.intp)].reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    if not areas.sum() > 0:
        return vertices, np.zeros_like(vertices)
    ends = np.cumsum(areas)
    drawn = np.searchsorted(ends, ends[-1] * (np.arange(_POINTS) + 0.5) / _POINTS)
    a, b = np.random.default_rng(0).random((2, _POINTS))
    # Uniform in a triangle by a square root; see Osada et al., Shape distributions (2002), eq. 1.
    share = np.stack([1 - np.sqrt(a), np.sqrt(a) * (1 - b), np.sqrt(a) * b], axis=1)
    points = np.einsum("ij,ijk->ik", share, corners[drawn])
    return points, normals[drawn] / areas[drawn, None]


def _png(pixels: Bytes) -> bytes:
    """Write shades with opacity (rows, columns, 2)."""
    n_rows, n_columns, _ = pixels.shape
    rows = np.concatenate([np.zeros((n_rows, 1), np.uint8), pixels.reshape(n_rows, -1)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    head = struct.pack(">IIBBBBB", n_columns, n_rows, 8, 4, 0, 0, 0)
    data = zlib.compress(rows.tobytes(), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


_FOLDER: Final = Path(__file__).parent / "bundle"

# Nothing is loaded, framed or sent from a page of the viewer, and no text becomes HTML or code.
NOTHING: Final = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; img-src blob: data:; "
    "require-trusted-types-for 'script'; trusted-types 'none'"
)
"""The part of the content security policy that all pages of the viewer have."""

AFTER_PAINT: Final = (
    'new PerformanceObserver(start).observe({type: "largest-contentful-paint", buffered: true}); '
    "setTimeout(start, 1000);"
)
"""Calls `start` once the text of a page is on the screen, or where nothing is painted."""

# A script of another type is neither compiled nor run until it is put into the page again.
_START: Final = (
    'const code = document.querySelector("script[data-code]"); '
    'const start = () => { code.type = "module"; document.body.append(code); }; ' + AFTER_PAINT
)


@cache
def script() -> str:
    """Give the script, one module without imports."""
    return (_FOLDER / "viewer.js").read_text(encoding="utf-8")


@cache
def style() -> str:
    """Give the style sheet."""
    return (_FOLDER / "viewer.css").read_text(encoding="utf-8")


@cache
def licences() -> str:
    """Licences of the libraries in the script."""
    return (_FOLDER / "LICENSES.txt").read_text(encoding="utf-8")


@cache
def decoder() -> bytes:
    """Give the WebAssembly that decodes compressed streams."""
    return (_FOLDER / "decode.wasm").read_bytes()


def source_hash(text: str) -> str:
    """Name a script or style sheet in a policy by its content."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def content_name(text: str) -> str:
    """Name a file by its content, so that a browser may keep it for ever."""
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def data_payload(data: SampledData) -> bytes:
    """Write points of all frames, in the viewer's form.

    Parameters
    ----------
    data : SampledData

    Returns
    -------
    bytes
        As of `write_container`. `points` (n, 3) are float32 from the header's `origin`, in its
        `length`: 1 in the unit of the sequence, but for extremes; `weights` (n,) from 0 of a
        stray to 255; `landmarks` (n,) 0 or 1; `counts` in the header has the points of each frame.
    """
    origin = data.points.mean(axis=0) if data.n_points else np.zeros(3)
    away = data.points - origin
    length = single_scale(float(np.abs(away).max(initial=0.0)))
    header = {"origin": origin.tolist(), "length": length, "counts": data.counts.tolist()}
    arrays: dict[str, Array] = {
        "points": (away / length).astype(np.float32),
        "weights": np.rint(255.0 * np.clip(data.weights, 0.0, 1.0)).astype(np.uint8),
        "landmarks": data.are_landmarks.astype(np.uint8),
    }
    return write_container(header, arrays)


# Of frames as they were sent: more would make a file that no browser opens.
MOST_BYTES: Final = 300_000_000

# Of one piece: a browser turns text into numbers a piece at a time.
_PIECE: Final = 4_000_000


@dataclass(frozen=True, eq=False)
class View:
    """A signature, its sequence, and results about it.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
    title : str
    template : Template or None
        The one that the signature's parameters name, if they name one.
    classification : Classification or None
    is_tracked : bool
        Whether the service that shows it has a track of it.
    data : SampledData or None
        Points that it was tracked through, for a page of one file.
    stream : bytes or None
        The compressed stream that the sequence was decoded from: a single-file page contains it and
        its decoder instead of the frames.
    """

    signature: ModalSignature
    sequence: MeshSequence
    title: str = ""
    template: Template | None = None
    classification: Classification | None = None
    is_tracked: bool = False
    data: SampledData | None = None
    stream: bytes | None = None

    def payload(self) -> bytes:
        """Write what the page needs first."""
        return view_payload(
            self.signature,
            self.sequence,
            template=self.template,
            classification=self.classification,
            title=self.title,
            is_tracked=self.is_tracked,
        )

    def pieces(self) -> list[bytes]:
        """Write all frames as they were sent, some at a time."""
        n, size = self.sequence.n_frames, 6 * self.sequence.n_vertices
        if n * size > MOST_BYTES:
            raise LimitError(
                f"The frames as sent take {n * size} bytes; a page contains at most {MOST_BYTES}.",
                remedy="Show fewer frames, or look at it in the service: /view/{id}.",
                limit="page_bytes",
                details={"value": n * size, "most": MOST_BYTES},
            )
        step = max(1, _PIECE // size)
        return [
            frames_payload(
                self.sequence,
                self.signature,
                first,
                min(first + step, n),
                template=self.template,
            )
            for first in range(0, n, step)
        ]


def view_page(views: Sequence[View]) -> str:
    """Write a page that shows one view, or two side by side.

    Parameters
    ----------
    views : one or two of View

    Returns
    -------
    str
        HTML with the viewer and all numbers in it; its policy forbids every request.

    Raises
    ------
    LimitError
        If the frames are too many for a page.
    """
    held, payloads = [], [view.payload() for view in views]
    for number, view in enumerate(views):
        held.append(_held(f'data-payload="{number}"', payloads[number]))
        if view.stream is None:
            held += [_held(f'data-frames="{number}"', piece) for piece in view.pieces()]
        else:
            held.append(_held(f'data-stream="{number}"', view.stream))
        if view.data is not None:
            held.append(_held(f'data-points="{number}"', data_payload(view.data)))
    sources = f"{source_hash(script())} {source_hash(_START)}"
    if any(view.stream is not None for view in views):
        held.append(_held("data-decoder", decoder()))
        # Lets WebAssembly be compiled, and nothing else.
        sources += " 'wasm-unsafe-eval'"
    policy = f"{NOTHING}; script-src {sources}; style-src {source_hash(style())}"
    title = " and ".join(view.title for view in views if view.title) or "A moving surface"
    return "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)} · modalmotion</title>",
            f"<style>{style()}</style></head>",
            f'<body><main id="modalmotion" class="modalmotion">{first_view(payloads)}</main>',
            f"<!-- {licences()} -->",
            *held,
            f'<script type="text/plain" data-code>{script()}</script>',
            f"<script>{_START}</script></body></html>",
            "",
        ]
    )


def _held(name: str, data: bytes) -> str:
    text = base64.b64encode(gzip.compress(data, 6, mtime=0)).decode()
    return f'<script type="application/octet-stream" {name}>{text}</script>'


def view(
    motion: MeshSequence | ModalSignature | Track,
    sequence: MeshSequence | None = None,
    *,
    parameters: SignatureParameters | None = None,
    template: Template | None = None,
) -> Any:
    """Show a moving surface beside its reconstruction in a notebook.

    Parameters
    ----------
    motion : MeshSequence, ModalSignature or Track
        Of a track the data are drawn over its surface.
    sequence : MeshSequence, optional
        The one that a signature was made from, which contains its surface.
    parameters : SignatureParameters, optional
        With which a sequence is fitted: 7 modes by default.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Returns
    -------
    anywidget.AnyWidget
        The same viewer as `modalmotion view` writes; it loads nothing.

    Raises
    ------
    ParameterError
        If a signature comes without its sequence, or with another.
    MissingExtraError
        If anywidget is not installed.
    """
    data = None
    if isinstance(motion, Track):
        data, motion = motion.data, motion.sequence
    if isinstance(motion, MeshSequence):
        sequence = motion
        signature = modal_signature(motion, parameters, template=template)
    elif sequence is None:
        raise ParameterError(
            "A signature contains amplitudes and no surface.",
            remedy="Give its sequence too: view(signature, sequence).",
        )
    else:
        signature = motion
    shown = View(signature, sequence, template=template)
    points = b"" if data is None else data_payload(data)
    return _widget()(payload=shown.payload(), frames=shown.pieces(), points=points)


@cache
def _widget() -> type:
    """Make the class of widgets, once."""
    with needs_extra("notebook"):
        import anywidget
        import traitlets

    class SurfaceWidget(anywidget.AnyWidget):  # type: ignore[misc]
        """A moving surface; payload and frames are what the page reads."""

        _esm = script()
        _css = style()
        payload = traitlets.Bytes().tag(sync=True)
        frames = traitlets.List(traitlets.Bytes()).tag(sync=True)
        points = traitlets.Bytes().tag(sync=True)

    return SurfaceWidget
