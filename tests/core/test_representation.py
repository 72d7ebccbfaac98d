"""Values show themselves in one line, with what matters of them."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project import ROOT
from reachable_values import reachable_values

import modalmotion as mm
from modalmotion.classification import TrainingCase, TrainingOptions, classify, load_model
from modalmotion.codec import encode, inspect
from modalmotion.formats import read_npz, write_npz
from modalmotion.limits import NO_LIMITS
from modalmotion.mesh import cavity_of, connectivity_of
from modalmotion.mesh.spring_modes import spring_modes
from modalmotion.modes import Oscillators, State, exact_step
from modalmotion.reports import report_of
from modalmotion.representation import LONGEST_LINE, csv_text, shown
from modalmotion.signature import measure_tradeoff
from modalmotion.signature.distance import compare
from modalmotion.store import ResultStore, backup, verify


@pytest.fixture(scope="module")
def beat() -> bytes:
    return write_npz(
        mm.simulate_ventricle(
            grid=(8, 16),
            acquisition=mm.Acquisition(n_frames=8, noise=0.3),
            rng=np.random.default_rng(3),
        )
    )


@pytest.fixture(scope="module")
def signature(beat: bytes) -> mm.ModalSignature:
    return mm.modal_signature(read_npz(beat).sequence, mm.SignatureParameters(modes=9))


def values_of_a_beat(beat: bytes, signature: mm.ModalSignature) -> Iterator[Any]:
    result = read_npz(beat)
    sequence = result.sequence
    template = mm.make_template(sequence)
    yield from (result, sequence, template, signature)
    yield mm.modal_signature(sequence, mm.SignatureParameters(topology="mesh", modes=7))
    yield mm.clinical_readouts(signature, sequence)
    yield compare(signature, signature)
    yield measure_tradeoff(sequence)
    encoded = encode(sequence, max_error=1.0)
    yield from (encoded, inspect(encoded.data), mm.strain(sequence))
    yield report_of(signature, sequence, issued=datetime.now(UTC))
    yield mm.track([*sequence.vertices[:3].astype(float)], modes=4, unit="mm")
    yield connectivity_of(sequence.faces, sequence.n_vertices)
    yield cavity_of(sequence.faces, sequence.n_vertices)
    yield spring_modes(sequence.faces, sequence.n_vertices, 5)


def values_of_models(signature: mm.ModalSignature) -> Iterator[Any]:
    model = load_model()
    yield from (model, classify(signature, model), TrainingOptions())
    yield TrainingCase(signature, "normal", "one")


def values_of_lattices() -> Iterator[Any]:
    lattice = mm.Lattice(mm.TORUS, (8, 8))
    yield from (lattice, mm.lowest_modes(mm.TORUS, 9), mm.VentricleParameters(), mm.Acquisition())
    yield from (NO_LIMITS, mm.End.POLE)
    oscillators = Oscillators(np.array([0.0, 1.0, 2.0, 3.0]), np.zeros(4))
    yield from (oscillators, State(np.ones((4, 3)), np.zeros((4, 3))), exact_step(oscillators, 0.1))


def values_of_a_store(folder: Path, beat: bytes, signature: mm.ModalSignature) -> Iterator[Any]:
    with ResultStore(folder / "store") as store:
        sequence = read_npz(beat).sequence
        yield store.put_sequence(sequence)
        yield store.list_sequences()
    yield backup(folder / "store", folder / "backup")
    yield verify(folder / "store")


def test_every_value_is_one_line(beat: bytes, signature: mm.ModalSignature, tmp_path: Path) -> None:
    kinds = set()
    too_long = set()
    starts = [
        *values_of_a_beat(beat, signature),
        *values_of_models(signature),
        *values_of_lattices(),
        *values_of_a_store(tmp_path, beat, signature),
    ]
    for value in reachable_values(starts):
        line = repr(value)
        if len(line) > LONGEST_LINE or "\n" in line or " object at 0x" in line:
            too_long.add(line)
        kinds.add(type(value).__name__)
    assert not too_long, "\n".join(sorted(line[:40] for line in too_long))
    public = {name for name in mm.__all__ if isinstance(getattr(mm, name), type)}
    assert {n for n in public if not n.endswith("Error")} <= kinds


def test_a_line_says_the_essentials(beat: bytes, signature: mm.ModalSignature) -> None:
    assert repr(signature).startswith(
        "ModalSignature(surface='cup', n_frames=8, modes=ModeSet[9], rms_error="
    )
    assert signature.sequence_id[:12] in repr(signature)
    assert repr(read_npz(beat).sequence) == (
        "MeshSequence(n_frames=8, n_vertices=128, faces=int64[224, 3], topology=cup, unit='mm')"
    )
    assert repr(mm.CUP) == "Topology(name='cup')"
    label = mm.lowest_modes(mm.CUP, 5).labels[4]
    assert eval(repr(label), {"ModeLabel": mm.ModeLabel}) == label  # noqa: S307 (our own text)


@shown("size", "inner.number", "text", "parts", "data")
@dataclass(frozen=True)
class Sample:
    text: str
    parts: tuple[object, ...] = ()
    data: bytes = b""
    size: float = 1 / 3
    inner: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "inner", self.inner or Inner())


@shown()
@dataclass(frozen=True)
class Inner:
    number: int = 7


@pytest.mark.parametrize(
    ("sample", "line"),
    [
        (Sample("a"), "Sample(size=0.3333, number=7, text='a', parts=(), data=bytes[0])"),
        (
            Sample("a" * 64, (np.zeros((2, 3)), 2.5), b"1234"),
            (
                "Sample(size=0.3333, number=7, text='aaaaaaaaaaaa'..., "
                "parts=(float64[2, 3], 2.5), data=bytes[4])"
            ),
        ),
        (
            Sample("a\nb", tuple(range(1000))),
            "Sample(size=0.3333, number=7, text='a\\nb', parts=tuple[1000], data=bytes[0])",
        ),
    ],
)
def test_attributes_are_brief(sample: Sample, line: str) -> None:
    assert repr(sample) == line
    assert repr(Inner()) == "Inner(number=7)"


def test_no_class_is_certain(signature: mm.ModalSignature) -> None:
    answer = classify(signature, load_model())
    sure = replace(answer, probabilities=np.eye(len(answer.classes))[0], label=answer.classes[0])
    assert "probability=> 0.99," in repr(sure)


def test_a_full_line_ends_with_an_ellipsis() -> None:
    line = repr(NO_LIMITS)
    assert len(line) == LONGEST_LINE
    assert line.endswith("...)")


@pytest.mark.parametrize(
    "text",
    ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", "\r=1", "\n=1", "=HYPERLINK(1)"],
)
def test_no_cell_of_a_table_is_a_formula(text: str) -> None:
    (row,) = csv.reader(io.StringIO(csv_text([[text, "b"]]), newline=""))
    assert row == ["'" + text.replace("\r", "\n"), "b"]


@pytest.mark.parametrize("number", [-1.5, -3, "-1.5e-07", "+2", "-inf", np.float64(-0.25)])
def test_numbers_stay_numbers(number: object) -> None:
    assert float(csv_text([[number]])) == float(str(number))


def test_every_table_is_written_by_one_function() -> None:
    for folder in ("core", "service"):
        for path in (ROOT / folder).rglob("*.py"):
            assert "csv.writer" not in path.read_text() or path.name == "representation.py", path
