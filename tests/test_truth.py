"""The table of truth: its rows, their kept values, the mutants that they notice, its verdicts."""

from __future__ import annotations

import math
import subprocess
from pathlib import Path

import pytest
from experiments import BLOCKS, REGISTERED, Row, experiments
from hypothesis import assume, given
from hypothesis import strategies as st
from mutate import WITHOUT, Mutant
from project import ROOT
from truth import Kept, Line, kept_of, markdown, read_kept

MUTANTS = sorted((ROOT / "benchmarks" / "mutants").glob("*.patch"))
figures = st.floats(-1e6, 1e6)
positive = st.floats(1e-3, 1e6)


@pytest.fixture(scope="module")
def rows() -> dict[str, Row]:
    # Slow: it imports what every row measures.
    return {row.name: row for each in experiments() for row in each.rows}


def test_no_two_rows_share_a_name_and_each_is_of_a_block(rows: dict[str, Row]) -> None:
    assert len(rows) == sum(len(each.rows) for each in REGISTERED)
    assert {name.split(".")[0] for name in rows} == set(BLOCKS)
    assert all(row.what for row in rows.values())


def test_each_row_is_kept_and_nothing_else(rows: dict[str, Row]) -> None:
    assert read_kept().keys() == rows.keys()


def test_tolerances_are_derived_or_stated(rows: dict[str, Row]) -> None:
    for name, kept in read_kept().items():
        stated = rows[name].tolerance
        if stated is not None:
            assert kept.tolerance == stated, name
            continue
        assert kept.seeds >= 5, name
        # Two digits are written.
        assert kept.tolerance <= 1.05 * 2 * kept.standard_error + 1e-12, name
        way = rows[name].way_to_goal(kept.value)
        assert kept.tolerance <= 1.05 * way / 3 or way == 0, name


def test_the_document_has_what_is_kept(rows: dict[str, Row]) -> None:
    assert rows
    text = (ROOT / "docs" / "truth.md").read_text()
    assert text == markdown(read_kept()), "run `make truth MARKDOWN=1`"


@pytest.mark.parametrize("path", MUTANTS, ids=lambda path: path.stem)
def test_a_mutant_names_rows_and_still_applies(path: Path, rows: dict[str, Row]) -> None:
    mutant = Mutant.read(path)
    assert mutant.what.endswith(".")
    assert mutant.rows
    assert rows.keys() >= set(mutant.rows)
    assert any(path.name.startswith(f"{block}_") for block in BLOCKS)
    applied = ["git", "apply", "--check", str(path)]
    run = subprocess.run(applied, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_each_row_of_a_result_is_noticed_by_a_mutant(rows: dict[str, Row]) -> None:
    named = {row for path in MUTANTS for row in Mutant.read(path).rows}
    assert [name for name in rows if name not in named and not name.startswith(WITHOUT)] == []


@given(figures, figures, positive)
def test_a_row_is_worse_beyond_its_tolerance_and_better_on_the_other_side(
    kept: float, change: float, tolerance: float
) -> None:
    slack = tolerance + 1e-3 * abs(kept)
    assume(abs(abs(change) - slack) > 1e-6 * (slack + abs(kept)))
    line = Line(Row("fit.x", "x"), Kept(kept, tolerance), kept + change)
    expected = "same" if abs(change) < slack else "WORSE" if change > 0 else "better"
    assert line.verdict == expected
    assert line.fails == (expected == "WORSE")
    mirrored = Line(Row("fit.x", "x", better="higher"), Kept(-kept, tolerance), -kept - change)
    assert mirrored.verdict == expected


@given(figures, figures, positive)
def test_a_row_is_short_on_the_wrong_side_of_its_goal(
    value: float, low: float, width: float
) -> None:
    high = low + width
    assert Row("fit.x", "x", goal=low).is_short(value) == (value > low)
    assert Row("fit.x", "x", goal=low, better="higher").is_short(value) == (value < low)
    assert Row("fit.x", "x", goal=(low, high)).is_short(value) == (not low <= value <= high)
    assert not Row("fit.x", "x").is_short(value)


@given(st.floats(0, 1), st.floats(0, 1), positive)
def test_all_within_a_range_is_alike_and_beyond_it_the_distance_counts(
    one: float, other: float, far: float
) -> None:
    row, kept = Row("fit.x", "x", goal=(0.0, 1.0)), Kept(one, far / 3)
    assert Line(row, kept, other).verdict == "same"
    for value in (1.0 + far + 0.01, -far - 0.01):
        assert Line(row, kept, value).verdict == "WORSE"
        assert Line(row, Kept(value, far / 3), other).verdict == "better"


def test_a_time_may_be_a_quarter_longer_as_on_a_busy_machine() -> None:
    row, kept = Row("fit.x", "x"), Kept(1.0, 0.01)
    assert Line(row, kept, 1.25, is_timed=True).verdict == "same"
    assert Line(row, kept, 1.3, is_timed=True).verdict == "WORSE"
    assert Line(row, kept, 1.25).verdict == "WORSE"


def test_what_is_not_measured_or_no_number_fails_and_what_is_skipped_does_not() -> None:
    row = Row("fit.x", "x", goal=1)
    assert Line(row, Kept(0, 1), math.nan).verdict == "WORSE"
    assert row.is_short(math.nan)
    assert Line(row, None, 0.0).verdict == "new"
    assert Line(row, Kept(0, 1), None, "ValueError: x").verdict == "FAILED"
    skipped = Line(row, Kept(0, 1), None, "skipped: heart not there")
    assert skipped.verdict == "skipped"
    assert [Line(row, None, 0.0).fails, skipped.fails] == [True, False]


@given(figures, figures, positive)
def test_a_tolerance_is_two_standard_errors_and_a_third_of_the_way_to_the_goal_at_most(
    value: float, goal: float, spread: float
) -> None:
    def tolerance(row: Row) -> float:
        return kept_of(Line(row, None, value), (spread, 5)).tolerance

    assert tolerance(Row("fit.x", "x")) == pytest.approx(2 * spread, rel=0.06)
    way = abs(float(f"{value:.6g}") - goal)
    bound = min(2 * spread, way / 3 if way else math.inf)
    assert tolerance(Row("fit.x", "x", goal=goal)) == pytest.approx(bound, rel=0.06)
    # Within a range the nearer bound counts.
    inside = Row("fit.x", "x", goal=(value - 3 * spread, value + 30 * spread))
    assert tolerance(inside) <= 1.06 * spread + 1e-5 * abs(value)
    stated = kept_of(Line(Row("fit.x", "x", tolerance=7.0), None, value), (spread, 5))
    assert (stated.tolerance, stated.standard_error) == (7.0, 0.0)


def test_the_date_of_what_was_measured_by_hand_stays() -> None:
    row = Row("use.x", "x", tolerance=1.0)
    line = Line(row, Kept(3.0, 1.0, recorded="2026-11-25"), 3.0)
    assert kept_of(line, None).recorded == "2026-11-25"
