"""Owners take turns by what their work costs."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from modalmotion_service.work.engine import FairQueue


def queue() -> FairQueue[str]:
    return FairQueue(lambda item: not item.startswith("unwanted"))


def taken(waiting: FairQueue[str]) -> list[str]:
    items = []
    while (item := waiting.take()) is not None:
        items.append(item)
    return items


def test_owners_take_turns_and_each_is_served_in_order() -> None:
    waiting = queue()
    for owner, n in (("a", 4), ("b", 2), ("c", 1)):
        for number in range(n):
            waiting.put(f"{owner}{number}", owner, 1.0)
    assert len(waiting) == 7
    assert taken(waiting) == ["a0", "b0", "c0", "a1", "b1", "a2", "a3"]
    assert not len(waiting)


def test_whoever_sends_dear_work_has_fewer_turns() -> None:
    waiting = queue()
    for number in range(10):
        waiting.put(f"dear {number}", "a", 5.0)
        waiting.put(f"cheap {number}", "b", 1.0)
    first = Counter(item.split()[0] for item in taken(waiting)[:12])
    assert first == {"cheap": 10, "dear": 2}


def test_nobody_saves_turns_up() -> None:
    waiting = queue()
    for number in range(6):
        waiting.put(f"a{number}", "a", 1.0)
    assert [waiting.take() for _ in range(3)] == ["a0", "a1", "a2"]
    for number in range(3):
        waiting.put(f"b{number}", "b", 1.0)
    assert taken(waiting) == ["b0", "a3", "b1", "a4", "b2", "a5"]


def test_going_away_and_coming_back_gains_nothing() -> None:
    waiting = queue()
    waiting.put("a0", "a", 10.0)
    waiting.put("b0", "b", 1.0)
    assert waiting.take() == "a0"
    # The owner has nothing here any more, and is ahead of the others all the same.
    waiting.put("a1", "a", 10.0)
    waiting.put("b1", "b", 1.0)
    assert taken(waiting) == ["b0", "b1", "a1"]


def test_what_nobody_wants_costs_its_owner_nothing() -> None:
    waiting = queue()
    for number in range(5):
        waiting.put(f"unwanted {number}", "a", 100.0)
    waiting.put("a", "a", 1.0)
    waiting.put("b0", "b", 2.0)
    waiting.put("b1", "b", 2.0)
    assert taken(waiting) == ["a", "b0", "b1"]


@pytest.mark.parametrize("price", [0.0, float("inf")])
def test_no_price_is_nothing_or_without_end(price: float) -> None:
    waiting = queue()
    for number in range(3):
        waiting.put(f"a{number}", "a", price)
        waiting.put(f"b{number}", "b", price)
    assert taken(waiting) == ["a0", "b0", "a1", "b1", "a2", "b2"]


@given(st.lists(st.tuples(st.sampled_from("abcd"), st.floats(0.01, 100.0)), max_size=60))
def test_everything_is_taken_once_and_no_owner_is_ahead_by_more_than_a_task(
    tasks: list[tuple[str, float]],
) -> None:
    waiting: FairQueue[tuple[str, float]] = FairQueue(lambda _: True)
    left: Counter[str] = Counter()
    for owner, price in tasks:
        waiting.put((owner, price), owner, price)
        left[owner] += 1
    spent = dict.fromkeys("abcd", 0.0)
    n_taken = 0
    while (item := waiting.take()) is not None:
        owner, price = item
        # Nobody who still waits has had less than whoever is served now.
        assert spent[owner] <= min(spent[other] for other in "abcd" if left[other]) + 1e-9
        spent[owner] += price
        left[owner] -= 1
        n_taken += 1
    assert n_taken == len(tasks)
