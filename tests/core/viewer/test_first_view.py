"""What a page of one file shows before its script has run."""

from __future__ import annotations

import base64
import io
import re

import numpy as np
import pytest
from viewed_surfaces import VIEWED, viewed

from modalmotion.representation import with_interval
from modalmotion.viewer.container import read_container, write_container
from modalmotion.viewer.page import View, first_view


def payload_of(name: str, title: str = "") -> bytes:
    sequence, signature = viewed(name)
    return View(signature, sequence, title).payload()


def picture_of(html: str) -> np.ndarray:
    image = pytest.importorskip("PIL.Image")
    text = re.findall(r"base64,([^\"]+)", html)[0]
    return np.asarray(image.open(io.BytesIO(base64.b64decode(text))))


def test_every_figure_of_the_payload_is_in_the_text_and_no_title_becomes_html() -> None:
    payload = payload_of("cup", "<script>a & b")
    header, _ = read_container(payload)
    html = first_view([payload])
    assert "&lt;script&gt;a &amp; b" in html
    assert "<script" not in html
    share = header["volume"]["share"]
    figures = [share, *header["volume"]["figures"], *header["strain"].get("figures", ())]
    assert len(figures) >= 4
    for figure in figures:
        value, ends = with_interval(figure["value"], figure["low"], figure["high"])
        assert f"{value} " in html
        assert ends in html


def test_two_views_have_a_picture_and_a_card_each() -> None:
    html = first_view([payload_of("cup"), payload_of("torus")])
    assert html.count("<img") == 2
    assert html.count('class="card') == 2


@pytest.mark.parametrize("name", VIEWED)
def test_the_picture_shows_the_surface_whole_and_shaded(name: str) -> None:
    shades, opacity = np.moveaxis(picture_of(first_view([payload_of(name)])), 2, 0)
    # Inside the margin, along the longer side from one end to the other, and without holes.
    drawn = opacity > 0
    rows, columns = np.nonzero(drawn)
    assert max(np.ptp(rows), np.ptp(columns)) == pytest.approx(0.9 * len(drawn), abs=2)
    around = drawn[:-2, 1:-1] & drawn[2:, 1:-1] & drawn[1:-1, :-2] & drawn[1:-1, 2:]
    assert (~drawn[1:-1, 1:-1] & around).mean() < 0.003
    assert np.ptp(shades[drawn]) > 30 or name == "plane"


def test_the_nearer_of_two_walls_is_seen() -> None:
    header, arrays = read_container(payload_of("plane"))
    header["view"] = np.eye(3).tolist()
    # From the side that the viewer shows first: before a wall, and behind it, a smaller one that
    # leans away.
    towards = np.array([np.sin(0.55) * np.cos(0.28), -np.cos(0.55) * np.cos(0.28), np.sin(0.28)])
    wall = 10.0 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    leaning = 0.2 * wall @ np.array([[1, 0, 0], [0, 1, 0], [0, 0.7, 1]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint16)
    one = {**arrays, "rest": wall, "faces": faces}
    pictures = [picture_of(first_view([write_container(header, one)]))]
    for side in (-1, 1):
        rest = np.concatenate([wall, leaning + 5.0 * side * towards])
        both = {**arrays, "rest": rest, "faces": np.concatenate([faces, faces + 4])}
        pictures.append(picture_of(first_view([write_container(header, both)])))
    alone, behind, before = (np.unique(one[..., 0][one[..., 1] > 0]) for one in pictures)
    assert (len(alone), len(before)) == (1, 2)
    assert np.array_equal(behind, alone)


def test_vertices_without_a_surface_are_drawn_as_points() -> None:
    header, arrays = read_container(payload_of("cup"))
    html = first_view([write_container(header, {**arrays, "faces": arrays["faces"][:0]})])
    assert (picture_of(html)[..., 1] > 0).sum() > 20
