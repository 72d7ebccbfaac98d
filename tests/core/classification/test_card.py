"""Cards as Markdown: tables, and texts that are nothing but texts."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from click.testing import CliRunner

from modalmotion.classification import DEFAULT_MODEL, ModelCard, card_markdown, load_model
from modalmotion.cli import main
from modalmotion.notes import Note


@pytest.fixture(scope="module")
def card() -> ModelCard:
    return load_model().card


def test_the_head_is_as_registries_read_it(card: ModelCard) -> None:
    page = card_markdown("mine@3", "0" * 64, card, head=True)
    _, head, rest = page.split("---\n", 2)
    assert yaml.safe_load(head)["library_name"] == "modalmotion"
    assert rest.lstrip() == card_markdown("mine@3", "0" * 64, card)
    assert "# mine@3" in page


def test_the_page_says_what_the_card_says(card: ModelCard) -> None:
    page = card_markdown("mine", "0" * 64, card)
    for heading in ("Intended use", "Training data", "Evaluation", "Class sets"):
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
    assert "\n---\n" not in page
    assert "\\# \\[x\\](y)" in page


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
    assert "its accuracy is unknown" in page


def test_the_command_gives_it_in_two_forms(tmp_path: Path) -> None:
    def run(*options: str) -> str:
        done = CliRunner().invoke(main, ["card", DEFAULT_MODEL, *options])
        assert done.exit_code == 0, done.output
        return done.output

    model = load_model()
    assert run() == card_markdown(model.name, model.id, model.card)
    assert json.loads(run("--json")) == model.card.as_json()
    place = tmp_path / "README.md"
    assert "README.md" in run("--markdown", "-o", str(place))
    assert place.read_text() == card_markdown(model.name, model.id, model.card, head=True)
