"""What the shipped model gives no class to: rates over hundreds of recordings of each kind."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import numpy as np
from measure import Table
from real_data import files_of, is_there

from modalmotion.classification import classify, load_model
from modalmotion.classification.training.train_shipped import MATERIAL, held_out_cases
from modalmotion.formats import read_sequence
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature, modal_signature
from modalmotion.simulate import MotionClass, simulate_cohort

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from altered_beats import ALTERED
from foreign_motions import FLAGGED, REPORTED, driven_by, figures

SEED: Final = 7
HELD_OUT_SEED: Final = 606
N_OF_A_KIND: Final = 200
N_HELD_OUT: Final = 400
LEAST: Final = 95.0
MOST_HELD_OUT: Final = 5.0

Rate = tuple[int, float, str, str]


def run(folder: Path, n: int = N_OF_A_KIND, n_held_out: int = N_HELD_OUT) -> list[Table]:
    """Measure the rates, and ask about the real ventricles."""
    del folder
    table = Table("Recordings without a class", ("what", "n", "flagged", "flags", "classes"))
    for kinds in (FLAGGED, REPORTED):
        for name, draw in kinds.items():
            rng = np.random.default_rng(SEED)
            _add(table, name, rate(draw(rng) for _ in range(n)), is_bound=kinds is FLAGGED)
    for name in ("fox", "robot"):
        if not is_there(f"classification_domain: {name}", name):
            continue
        _add(table, f"{name}, its windows", rate(figures(name)), is_bound=True)
        rng = np.random.default_rng(SEED)
        moving = (driven_by(name, rng) for _ in range(n))
        _add(table, f"{name}, as a cup or cylinder", rate(moving), is_bound=True)
    held_out = rate(case.signature for case in held_out_cases(MATERIAL, n_held_out, HELD_OUT_SEED))
    count, share, flags, classes = held_out
    cells = ("held-out ventricles", str(count), f"{share:.1f} %", flags, classes)
    table.add_at_most(share, MOST_HELD_OUT, *cells)
    tables = [table, _altered(n)]
    return (
        [*tables, _real()] if is_there("classification_domain: a real heart", "heart") else tables
    )


def _altered(n: int) -> Table:
    """Beats of all classes in equal parts, altered; unsure where the set holds not one class."""
    table = Table(
        "Altered beats", ("what", "n", "flagged", "unsure", "flagged, unsure or right", "flags")
    )
    for name, (alter, _) in ALTERED.items():
        rng = np.random.default_rng(SEED)
        flags: Counter[str] = Counter()
        unsure = right = 0
        for case in simulate_cohort(n // len(MotionClass), rng=rng):
            answer = classify(alter(case.sequence, rng))
            flags.update(answer.flags[:1])
            if not answer.flags:
                unsure += len(answer.class_set) != 1
                right += answer.class_set == (str(case.label),)
        total = n // len(MotionClass) * len(MotionClass)
        sound = 100.0 * (flags.total() + unsure + right) / total
        said = ", ".join(f"{k} {v}" for k, v in flags.most_common())
        cells = (f"{100 * k / total:.1f} %" for k in (flags.total(), unsure))
        table.add_at_least(sound, LEAST, name, str(total), *cells, f"{sound:.1f} %", said)
    return table


def rate(motions: Iterable[ModalSignature | MeshSequence]) -> Rate:
    """How many there are, which percentage is flagged, by which flags, and what the rest is."""
    model = load_model()
    flags: Counter[str] = Counter()
    classes: Counter[str] = Counter()
    for motion in motions:
        found = classify(motion, model)
        flags.update(found.flags)
        classes.update([] if found.label is None else [found.label])
    n = flags.total() + classes.total()
    texts = [", ".join(f"{k} {v}" for k, v in c.most_common()) for c in (flags, classes)]
    return n, 100.0 * flags.total() / n, texts[0], texts[1]


def _add(table: Table, name: str, found: Rate, *, is_bound: bool) -> None:
    n, share, flags, classes = found
    cells = (name, str(n), f"{share:.1f} %", flags, classes)
    if is_bound:
        table.add_at_least(share, LEAST, *cells)
    else:
        table.add(*cells)


def _real() -> Table:
    table = Table("A real heart", ("what", "answer", "distance", "limit", "would be", "at"))
    model = load_model()
    for path in files_of("heart"):
        signature = modal_signature(read_sequence(path).sequence, model.signature_parameters)
        answer = classify(signature, model)
        said = answer.label or answer.flags[0]
        if signature.surface not in model.readable.topologies:
            table.add(path.stem, said, "", "", "", "")
            continue
        found = model.read(signature)
        distances = model.distance(model.domain.reader.read(signature).kinds)
        shares = model.probabilities(found.values[[distances.argmin()]])[0]
        table.add(
            path.stem,
            said,
            f"{distances.min():.2f}",
            f"{model.domain.limit:.2f}",
            model.classes[int(shares.argmax())],
            f"{shares.max():.0%}",
        )
    return table
