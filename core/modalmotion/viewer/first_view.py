"""What a single-file page shows before its script runs, or where scripts are not run."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Mapping
from html import escape
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.representation import with_interval
from modalmotion.viewer.container import read_container

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


def _picture(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> str:
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


def _sampled(
    vertices: NDArray[np.float64], faces: NDArray[Any]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def _png(pixels: NDArray[np.uint8]) -> bytes:
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
