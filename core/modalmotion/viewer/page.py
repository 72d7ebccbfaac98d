"""A view as one HTML file, which opens from disk and loads nothing."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Final

from modalmotion.classification.answer import Classification
from modalmotion.errors import LimitError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature
from modalmotion.template import Template
from modalmotion.tracking.result import SampledData
from modalmotion.viewer.bundle_files import (
    NOTHING,
    decoder,
    licences,
    script,
    source_hash,
    style,
)
from modalmotion.viewer.data_payload import data_payload
from modalmotion.viewer.payload import frames_payload, view_payload

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
    held = []
    for number, view in enumerate(views):
        held.append(_held(f'data-payload="{number}"', view.payload()))
        if view.stream is None:
            held += [_held(f'data-frames="{number}"', piece) for piece in view.pieces()]
        else:
            held.append(_held(f'data-stream="{number}"', view.stream))
        if view.data is not None:
            held.append(_held(f'data-points="{number}"', data_payload(view.data)))
    sources = source_hash(script())
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
            f"<!-- {licences()} -->",
            f"<style>{style()}</style></head>",
            '<body><main id="modalmotion" class="modalmotion"></main>',
            *held,
            f'<script type="module">{script()}</script></body></html>',
            "",
        ]
    )


def _held(name: str, data: bytes) -> str:
    text = base64.b64encode(gzip.compress(data, 6, mtime=0)).decode()
    return f'<script type="application/octet-stream" {name}>{text}</script>'
