"""What the model commands print."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING

from modalmotion.representation import numeral, probability

if TYPE_CHECKING:
    from modalmotion.classification import Classification, Model


def card_text(model: Model, *, markdown: bool = False, file: str | None = None) -> str:
    """Write a model's card as Markdown, with the YAML head of registries if so."""
    from modalmotion.classification import card_markdown

    page = card_markdown(model.name, model.id, model.card, file=file)
    return page if markdown else page.split("---\n", 2)[2].lstrip()


def confusion(
    classes: tuple[str, ...], counts: tuple[tuple[int, ...], ...]
) -> list[dict[str, object]]:
    """Give the rows of a table of answers by true class."""
    answers = [*classes, "no class"]
    return [
        {"true class": label, **dict(zip(answers, row, strict=False))}
        for label, row in zip(classes, counts, strict=False)
    ]


def answer_lines(result: Classification) -> Iterator[str]:
    """Write a model's answer for a sequence."""
    if result.label is None:
        yield f"{result.model}: no class"
    else:
        yield f"{result.model}: {result.label}, probability {probability(result.probability)}"
    yield from (f"flag: {flag}" for flag in result.flags)
    # Equal probabilities are not a measurement.
    if result.label is not None:
        shares = dict(zip(result.classes, result.probabilities.tolist(), strict=True))
        for name, share in sorted(shares.items(), key=lambda item: -item[1]):
            mark = "*" if name in result.class_set else " "
            yield f"  {probability(share):>6} {mark} {name}"
        if result.class_set:
            yield f"* cannot be excluded at {100 * result.coverage:g} %"
    for part in result.explanation[:5]:
        size = f"{numeral(part.amplitude):>8} {part.unit or 'length units'}"
        yield f"  {part.score:+7.2f}  {size}  {' '.join(part.modes)}"
    yield from (f"note: {note}" for note in result.notes)


def answer_json(result: Classification) -> dict[str, object]:
    """Give the members of a model's answer for a sequence, as JSON has them."""
    return {
        "sequence_id": result.sequence_id,
        "model": result.model,
        "model_id": result.model_id,
        "label": result.label,
        "probabilities": dict(zip(result.classes, result.probabilities.tolist(), strict=True)),
        "class_set": list(result.class_set),
        "coverage": result.coverage,
        "flags": list(result.flags),
        "explanation": [asdict(part) for part in result.explanation],
        "notes": list(result.notes),
    }
