"""Who may send work to a cluster next."""

from __future__ import annotations

import asyncio

import pytest

from modalmotion_service.errors import ClusterError
from modalmotion_service.work.dask.turns import Turns, lane_of, places_for_long
from modalmotion_service.work.terms import NO_TERMS, Terms

LONG, SHORT = 10.0, 0.01


class Crowd:
    """Tasks that take turns and are ended by name."""

    def __init__(self, *n_threads: int) -> None:
        self.turns = Turns()
        self.turns.set_threads(n_threads)
        self.begun: list[str] = []
        self.ends: dict[str, asyncio.Event] = {}
        self.tasks: dict[str, asyncio.Task[None]] = {}

    async def send(self, name: str, terms: Terms) -> None:
        async def take() -> None:
            async with self.turns.turn(terms):
                self.begun.append(name)
                await self.ends[name].wait()

        self.ends[name] = asyncio.Event()
        self.tasks[name] = asyncio.create_task(take())
        await asyncio.sleep(0)

    async def end(self, name: str) -> None:
        self.ends[name].set()
        await self.tasks[name]
        await asyncio.sleep(0)


def test_one_thread_of_each_worker_is_left_for_short_work() -> None:
    assert [places_for_long(n) for n in (1, 2, 9)] == [1, 1, 8]
    assert [lane_of(Terms("a", price)) for price in (SHORT, LONG)] == ["short", "long"]


def test_owners_take_turns_and_short_work_waits_for_no_long_work() -> None:
    async def run() -> None:
        crowd = Crowd(2, 2)
        for number in range(6):
            await crowd.send(f"a{number}", Terms("a", LONG))
        await crowd.send("b0", Terms("b", LONG))
        await crowd.send("b short", Terms("b", SHORT))
        await crowd.send("cohort", NO_TERMS)
        assert crowd.begun == ["a0", "a1", "b short", "cohort"]
        assert crowd.turns.n_waiting == {"short": 0, "long": 5}
        await crowd.end("a0")
        assert crowd.begun[4:] == ["b0"]
        # One that is cancelled in the queue is passed over; one that is at work leaves its place.
        crowd.tasks["a2"].cancel()
        crowd.tasks["a1"].cancel()
        await asyncio.wait([crowd.tasks["a1"], crowd.tasks["a2"]])
        await asyncio.sleep(0)
        assert crowd.begun[5:] == ["a3"]
        crowd.turns.set_threads([5])
        await asyncio.sleep(0)
        assert crowd.begun[6:] == ["a4", "a5"]
        for name in ("a3", "a4", "a5", "b0", "b short", "cohort"):
            await crowd.end(name)
        assert crowd.turns._under_way == {"short": 0, "long": 0}

    asyncio.run(run())


def test_without_workers_all_that_wait_are_told() -> None:
    async def run() -> None:
        crowd = Crowd(1)
        for name in ("a0", "a1", "a2"):
            await crowd.send(name, Terms("a", LONG))
        crowd.turns.give_up(ClusterError("text"))
        for name in ("a1", "a2"):
            with pytest.raises(ClusterError):
                await crowd.tasks[name]
        await crowd.end("a0")
        await crowd.send("a3", Terms("a", LONG))
        assert crowd.begun == ["a0", "a3"]
        await crowd.end("a3")

    asyncio.run(run())
