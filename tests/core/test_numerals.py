"""Numbers on the screen and in pictures: readable in every unit."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import modalmotion as mm
from modalmotion.cli.commands import main
from modalmotion.formats import read_sequence
from modalmotion.mesh.sequence import in_time_order
from modalmotion.pictures.signature import signature_figure
from modalmotion.representation import counted, numeral, probability, with_interval


@given(st.floats(1e-300, 1e300), st.integers(1, 3), st.sampled_from([1, -1]))
def test_three_digits_are_always_shown(size: float, decimals: int, sign: int) -> None:
    shown = numeral(sign * size, decimals)
    assert float(shown) == pytest.approx(sign * size, rel=0.0051)
    assert len(shown) <= 12


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (9.3071, "9.307"),
        (0.0, "0.000"),
        (0.000288, "0.000288"),
        (0.05, "0.0500"),
        (1e30, "1.00e+30"),
    ],
)
def test_millimetres_have_three_decimals_and_nothing_becomes_zero(value: float, shown: str) -> None:
    assert numeral(value) == shown


def test_rounding_beside_the_motion_is_zero() -> None:
    assert numeral(3e-14, of=9.0) == "0.000"
    assert numeral(3e-14, of=1e-13) == "3.00e-14"


def test_one_is_singular() -> None:
    assert [counted(1, "frame"), counted(2, "frame")] == ["1 frame", "2 frames"]
    assert counted(0, "vertex", "vertices") == "0 vertices"


@pytest.fixture(scope="module")
def in_metres(tmp_path_factory: pytest.TempPathFactory) -> Path:
    beat = mm.simulate_ventricle(rng=np.random.default_rng(3))
    path = tmp_path_factory.mktemp("metres") / "beat.npz"
    metres = mm.mesh_sequence(
        np.asarray(beat.vertices, dtype=np.float64)[::5] / 1000,
        grid=(32, 64),
        topology="cup",
        unit="m",
    )
    path.write_bytes(mm.write_npz(metres))
    return path


@pytest.mark.parametrize("command", [["signature"], ["tradeoff", "--front-modes", "20"]])
def test_no_length_in_metres_is_shown_as_zero(in_metres: Path, command: list[str]) -> None:
    result = CliRunner().invoke(main, [*command, str(in_metres)])
    assert result.exit_code == 0, result.output
    assert "0.000 " not in result.output
    assert "0.000," not in result.output


def test_titles_of_pictures_show_metres(in_metres: Path) -> None:
    beat = read_sequence(in_metres).sequence
    titles = [axes.get_title() for axes in signature_figure(beat, mm.modal_signature(beat)).axes]
    assert not [title for title in titles if re.search(r"0\.00\b", title)]


def test_notes_on_a_single_frame_are_in_the_singular() -> None:
    vertices = np.random.default_rng(2).normal(size=(3, 12, 3))
    _, _, notes = in_time_order(vertices[[0, 1, 1, 2]], [0.0, 0.1, 0.1, 0.2])
    assert [str(note) for note in notes] == [
        "Repeated at the same time and dropped: 1 frame (first: frame 2)."
    ]


@pytest.mark.parametrize(
    ("value", "low", "high", "said"),
    [
        (62.14, 60.94, 63.36, ("62.1", "60.9 to 63.4")),
        (179.031, 179.011, 179.043, ("179.03", "179.01 to 179.04")),
        (179.031, 179.0309, 179.0311, ("179.03", "\u00b1 less than 0.01")),
    ],
)
def test_an_interval_never_has_two_ends_alike(
    value: float, low: float, high: float, said: tuple[str, str]
) -> None:
    assert with_interval(value, low, high) == said


def test_a_probability_is_never_shown_as_certain() -> None:
    texts = [probability(p) for p in (0.5, 0.99, 0.9901, 1.0)]
    assert texts == ["0.50", "0.99", "> 0.99", "> 0.99"]
