"""A view as one HTML file that opens from disk and loads nothing, and as a widget in a notebook."""

from __future__ import annotations

import base64
import gzip
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.answer import Classification
from modalmotion.errors import LimitError, ParameterError, needs_extra
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.template import Template
from modalmotion.tracking.result import SampledData, Track
from modalmotion.viewer.container import write_container
from modalmotion.viewer.first_view import first_view
from modalmotion.viewer.payload import frames_payload, single_scale, view_payload

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
    arrays: dict[str, NDArray[Any]] = {
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
