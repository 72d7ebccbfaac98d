"""The built files of the viewer: script and style sheet."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from pathlib import Path
from typing import Final

_FOLDER: Final = Path(__file__).parent / "bundle"

# Nothing is loaded, framed or sent from a page of the viewer, and no text becomes HTML or code.
NOTHING: Final = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; img-src blob: data:; "
    "require-trusted-types-for 'script'; trusted-types 'none'"
)
"""The part of the content security policy that all pages of the viewer have."""


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
