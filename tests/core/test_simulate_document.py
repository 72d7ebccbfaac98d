"""docs/simulation.md runs, and its numbers are those of the shipped model."""

from __future__ import annotations

import re
from pathlib import Path

from modalmotion.classify import load_model

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "simulation.md"


def test_its_code_runs() -> None:
    namespace: dict[str, object] = {}
    blocks = re.findall(r"^```python\n(.*?)^```", DOCUMENT.read_text(), re.MULTILINE | re.DOTALL)
    for block in blocks:
        exec(block, namespace)  # noqa: S102 (our own document)
    assert len(blocks) == 3


def test_its_figures_are_those_of_the_model_card() -> None:
    held_out = load_model().card["held_out"]
    text = DOCUMENT.read_text()
    for mesh in ("all", "lattice", "triangles"):
        assert f"{held_out[mesh]['accuracy']:.1%}" in text, mesh
    assert f"{held_out['all']['calibration_error']:.3f}" in text
