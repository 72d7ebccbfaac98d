"""Workers that are not heard of."""

from __future__ import annotations

from modalmotion_service.work.dask.hearing import Hearing


def workers(**last_seen: float) -> dict[str, dict[str, float]]:
    return {address: {"last_seen": time} for address, time in last_seen.items()}


def test_a_worker_is_silent_when_what_the_scheduler_says_of_it_stays_the_same() -> None:
    hearing = Hearing()
    # The scheduler's clock may show anything.
    for second in range(60):
        hearing.note(workers(a=1e9 + second, b=1e9 + min(second, 30)), float(second))
        assert set(hearing.heard) == ({"a", "b"} if second < 40 else {"a"}), second
        assert set(hearing.silent) == (set() if second < 40 else {"b"}), second
    hearing.note(workers(a=1e9 + 60, b=1e9 + 60), 60.0)
    assert list(hearing.heard) == ["a", "b"]
    hearing.note(workers(b=1e9 + 61), 61.0)
    assert list(hearing.heard) == ["b"]
    assert not hearing.silent


def test_of_many_workers_each_is_heard_more_seldom() -> None:
    hearing, many = Hearing(), {f"w{n}": 0.0 for n in range(2000)}
    hearing.note(workers(**many), 0.0)
    hearing.note(workers(**many), 40.0)
    assert not hearing.silent
