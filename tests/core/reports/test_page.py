"""The page for people."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise

import pytest
from norm_controls import beat

import modalmotion as mm
from modalmotion.classification import classify
from modalmotion.clinical.strain import DYSSYNCHRONY
from modalmotion.reports import quantities_of, report_figure, report_of, report_pdf
from modalmotion.representation import with_interval

pytest.importorskip("matplotlib")

ISSUED = datetime(2026, 1, 31, 12, tzinfo=UTC)


def test_the_page_says_what_the_report_says_and_stays_on_the_page() -> None:
    sequence = beat(5)
    signature = mm.modal_signature(sequence, mm.SignatureParameters(modes=7))
    report = report_of(signature, sequence, issued=ISSUED, classification=classify(sequence))
    # Caveats that would fill three pages.
    report = replace(report, absent=tuple(f"caveat {k} " + "word " * 40 for k in range(60)))
    figure = report_figure(report)
    figure.draw_without_rendering()
    said = [text for text in figure.texts if text.get_text()]
    texts = "\n".join(text.get_text() for text in said)
    for one in quantities_of(report):
        value, ends = with_interval(one.value, one.low, one.high)
        assert f"{value} {one.unit}" in texts
        assert ends in texts
    assert report.digest in texts
    assert report.ventricle is not None
    assert report.ventricle.strain is not None
    assert (report.ventricle.strain.dyssynchrony is None) == (DYSSYNCHRONY not in texts)
    assert "Global area strain (GAS): relative change" in texts
    # No anterior wall is stated.
    assert "rings from the base to the apex" in texts
    assert "Not a medical device" in texts
    assert "preliminary" in texts
    boxes = [text.get_window_extent() for text in said]
    width, height = figure.bbox.width, figure.bbox.height
    assert all(b.x0 >= 0 and b.x1 <= width and b.y0 >= 0 and b.y1 <= height for b in boxes)
    left = sorted((b for b in boxes if b.x0 < 0.1 * width), key=lambda box: -box.y1)
    assert all(above.y0 >= below.y1 - 1 for above, below in pairwise(left))


def test_the_same_report_is_the_same_pdf() -> None:
    still = beat(6)
    signature = mm.modal_signature(still, mm.SignatureParameters(modes=4))
    report = report_of(signature, still, issued=ISSUED)
    data = report_pdf(report)
    assert data.startswith(b"%PDF")
    assert data == report_pdf(report)
