"""A signature as notebooks show it."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from viewed_surfaces import VIEWED, viewed

from modalmotion.exports.files import to_html
from modalmotion.mesh.alignment import Rotations
from modalmotion.notes import Note


class Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.seen: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.add(tag)
        assert not any(name.startswith("on") or name in ("src", "href") for name, _ in attrs)


@pytest.mark.parametrize("name", VIEWED)
def test_it_is_static_and_says_what_the_modes_are(name: str) -> None:
    signature = viewed(name)[1]
    text = signature._repr_html_()
    assert text == to_html(signature)
    tags = Tags()
    tags.feed(text)
    assert tags.seen >= {"table", "svg", "polyline"}
    assert not tags.seen & {"script", "img", "iframe", "link", "style"}


def test_modes_along_normals_are_named_as_such() -> None:
    sequence = viewed("cup")[0]
    along = to_html(sequence.signature(kind="normal_displacement"))
    assert "all outward or all inward" in along
    assert "translation" not in along
    assert "translation" in to_html(sequence.signature())


def test_ten_thousand_frames_stay_small() -> None:
    signature = viewed("cup")[1]
    n = 10_000
    repeated = np.resize(np.arange(signature.n_frames), n)
    long = replace(
        signature,
        amplitudes=signature.amplitudes[repeated],
        motion_rms=signature.motion_rms[repeated],
        rms_errors=signature.rms_errors[repeated],
        max_errors=signature.max_errors[repeated],
        rotations=Rotations.none(n),
        times=None,
        notes=(Note("long", "x" * 100_000),) * 50,
    )
    assert len(to_html(long).encode()) <= 30_000


def test_texts_are_escaped_and_extremes_are_drawn() -> None:
    signature = replace(viewed("cup")[1], notes=(Note("script", "<script>alert(1)</script>"),))
    assert "<script>" not in to_html(signature)
    for size in (0.0, 1e-300, 1e300):
        huge = replace(signature, amplitudes=signature.amplitudes / 20.0 * size)
        assert "nan" not in to_html(huge).lower()
