"""The site's own pages: what they show runs, and what they name is there."""

from __future__ import annotations

import re

import pytest
from project import ROOT

import modalmotion as mm


def test_the_tutorial_runs() -> None:
    pytest.importorskip("matplotlib")
    text = (ROOT / "docs/start.md").read_text()
    namespace: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        exec(block, namespace)  # noqa: S102 (our own tutorial)


def test_the_reference_names_what_is_public() -> None:
    listed = re.findall(
        r"^   (\w+)$", (ROOT / "docs/reference/python.md").read_text(), re.MULTILINE
    )
    assert len(listed) > 30
    assert set(listed) <= set(dir(mm))


def test_each_page_is_in_the_index() -> None:
    index = (ROOT / "docs/index.md").read_text()
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"}
    assert pages <= set(re.findall(r"^([\w/]+)$", index, re.MULTILINE))


def test_there_is_a_gallery_of_twelve_questions() -> None:
    pages = sorted((ROOT / "docs/gallery").glob("plot_*.py"))
    assert len(pages) == 12
    for page in pages:
        assert page.read_text().splitlines()[1].endswith("?")
