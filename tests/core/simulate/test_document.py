"""Documents of docs run: simulation, classification, error, norms; figures are the model card's."""

from __future__ import annotations

import re

import pytest
from project import ROOT

from modalmotion.classification import load_model

DOCUMENTS = ROOT / "docs"


@pytest.mark.parametrize(
    ("name", "n_blocks"),
    [
        ("simulation.md", 3),
        ("classification.md", 9),
        ("error.md", 2),
        ("norms.md", 2),
        ("interoperability.md", 2),
    ],
)
def test_its_code_runs(name: str, n_blocks: int) -> None:
    namespace: dict[str, object] = {}
    text = (DOCUMENTS / name).read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    for block in blocks:
        exec(block, namespace)  # noqa: S102 (our own document)
        for claim in re.findall(r"^(.+?) +# True$", block, re.MULTILINE):
            assert eval(claim, namespace), claim  # noqa: S307
    assert len(blocks) == n_blocks


def test_its_figures_are_those_of_the_model_card() -> None:
    held_out = load_model().card.extra["held_out"]
    text = (DOCUMENTS / "classification.md").read_text()
    for name in ("accuracy", "abstained"):
        assert f"{held_out[name]:.1%}" in text, name
    for name in ("calibration_error", "mean_set_size"):
        assert f"{held_out[name]:.3f}" in text, name
    for label, share in held_out["class_coverage"].items():
        assert f"| {label} | {share:.1%} |" in text, label
