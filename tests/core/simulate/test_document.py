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
        ("classification.md", 8),
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


@pytest.mark.parametrize("name", ["ventricle-simulated", "ventricle-simulated-normal-displacement"])
def test_its_figures_are_those_of_the_model_card(name: str) -> None:
    card = load_model(name).card
    held_out = card.extra["held_out"]
    low, high = (f"{100 * share:.1f}" for share in held_out["accuracy_interval"])
    covered = [f"{100 * share:.0f}" for share in sorted(held_out["class_coverage"].values())]
    row = (
        *(f"`{name}`", card.has_seen.split()[0], str(held_out["n_cases"])),
        f"{100 * held_out['accuracy']:.1f} % ({low} to {high})",
        f"{100 * held_out['abstained']:.1f} %",
        f"{held_out['calibration_error']:.3f}",
        f"{covered[0]} to {covered[-1]} %",
    )
    assert f"| {' | '.join(row)} |" in (DOCUMENTS / "classification.md").read_text()
