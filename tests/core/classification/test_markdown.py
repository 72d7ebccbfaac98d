"""Cards as Markdown: a head that YAML reads, tables, and texts that are nothing but texts."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from modalmotion.classification import DEFAULT_MODEL, ModelCard, card_markdown, load_model
from modalmotion.cli import main
from modalmotion.notes import Note
from modalmotion.store import model_to_hdf5


@pytest.fixture(scope="module")
def card() -> ModelCard:
    return load_model().card


def head_of(page: str) -> dict[str, Any]:
    _, head, _ = page.split("---\n", 2)
    found: dict[str, Any] = yaml.safe_load(head)
    return found


def test_the_head_is_as_registries_read_it(card: ModelCard) -> None:
    page = card_markdown("mine", "0" * 64, card, version=3)
    assert page == card_markdown("mine", "0" * 64, card, version=3)
    head = head_of(page)
    assert head["library_name"] == "modalmotion"
    assert f"| Accuracy | {card.accuracy:.3f} |" in page
    assert "# mine@3" in page


def test_the_page_says_what_the_card_says(card: ModelCard) -> None:
    page = card_markdown("mine", "0" * 64, card)
    for heading in ("Intended use", "Training data", "Evaluation", "Class sets", "How to use it"):
        assert f"\n## {heading}\n" in page
    for label in card.classes:
        n = f"| {label} | {card.n_cases[label]} | {card.n_subjects[label]} |"
        assert n in page
    assert card.training_set in page
    for line in page.splitlines():
        if line.startswith("| "):
            assert line.endswith(" |")
    rows = [line for line in page.splitlines() if line.startswith("| true class")]
    assert rows[0].count("|") == len(card.confusion[0]) + 2


def test_the_command_on_the_page_names_a_file_that_is_one(card: ModelCard) -> None:
    def shown(name: str, **where: Any) -> str:
        return card_markdown(name, "0" * 64, card, **where).split("```sh\n")[1].split("\n```")[0]

    asked = "modalmotion classify beat.npz --model"
    assert shown(DEFAULT_MODEL) == f"{asked} {DEFAULT_MODEL}"
    assert shown("mine") == f"{asked} mine.h5"
    assert shown("mine", version=3) == f"{asked} mine-3.h5"
    assert shown("mine", file="models/mine.h5") == f"{asked} models/mine.h5"
    assert shown("mine", file="my models/mine.h5") == f"{asked} 'my models/mine.h5'"
    for odd in ("a\n```\nb.h5", "a`b.h5"):
        assert shown("mine", file=odd) == f"{asked} mine.h5"
    page = card_markdown("mine", "0" * 64, card)
    assert "only models included in the package have names" in page


def test_texts_of_others_stay_texts(card: ModelCard) -> None:
    odd = "a|b <script>\n---\n# [x](y)"
    renamed = replace(
        card,
        classes=(odd, *card.classes[1:]),
        n_cases={odd: 3, **card.n_cases},
        n_subjects={odd: 2, **card.n_subjects},
        notes=(Note("odd", odd),),
    )
    page = card_markdown("mine", "0" * 64, renamed)
    assert "<script>" not in page
    assert page.count("\n---\n") == 1
    assert "\\# \\[x\\](y)" in page
    assert head_of(page)["library_name"] == "modalmotion"


def test_a_card_without_figures_says_so(card: ModelCard) -> None:
    bare = replace(
        card,
        accuracy=None,
        balanced_accuracy=None,
        auc=None,
        log_loss=None,
        brier=None,
        calibration_error=None,
        class_coverage={},
        confounds=(),
        notes=(),
    )
    page = card_markdown("mine", "0" * 64, bare)
    assert "model-index" not in head_of(page)
    assert "its accuracy is unknown" in page


def test_the_command_gives_it_in_three_forms(tmp_path: Path) -> None:
    def run(*options: str) -> str:
        done = CliRunner().invoke(main, ["card", DEFAULT_MODEL, *options])
        assert done.exit_code == 0, done.output
        return done.output

    own = tmp_path / "mine.h5"
    own.write_bytes(model_to_hdf5(load_model()))
    done = CliRunner().invoke(main, ["card", str(own), "--markdown"])
    assert f"--model {shlex.quote(str(own))}\n" in done.output
    model = load_model()
    assert run("--markdown") == card_markdown(model.name, model.id, model.card)
    assert json.loads(run("--json")) == model.card.as_json()
    assert model.id[:12] in run()
    place = tmp_path / "README.md"
    assert "README.md" in run("--markdown", "-o", str(place))
    assert place.read_text() == card_markdown(model.name, model.id, model.card)
