"""What a worker tells through a file reaches whoever waits for it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from modalmotion.mesh.sequence import sequence_to_hdf5
from modalmotion.progress import Progress
from modalmotion.simulate import simulate_ventricle
from modalmotion_service.schemas.requests import EncodingTarget
from modalmotion_service.work.engine import Engine, Terms
from modalmotion_service.work.tariff import Tariff
from modalmotion_service.work.tasks import files, sequences
from modalmotion_service.work.tasks.files import ProgressFile
from modalmotion_service.workspace import analysis
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.spool import Quota, Spool


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(analysis, "_POLL_SECONDS", 0.005)
    monkeypatch.setattr(files, "_LEAST_SECONDS", 0.0)


class NoWorker(Engine):
    """Hands a task's `ProgressFile` to the test, which works in the worker's place."""

    n_workers = 1

    def __init__(self) -> None:
        self.work: Future[Any] = Future()

    def require_ready(self) -> None:
        """Be ready."""

    def submit_for(
        self, terms: Terms, fn: Callable[..., Any], /, *args: Any, **_: Any
    ) -> Future[Any]:
        self.file = ProgressFile(args[-1])
        return self.work


def analysis_with(engine: Engine, folder: Path) -> Analysis:
    spool, tariff = Spool(folder), Tariff("", 20.0, 2.0)
    return Analysis(None, engine, spool, tariff, Quota(folder))  # type: ignore[arg-type]


def test_shares_are_told_in_their_order_until_the_work_is_done(tmp_path: Path) -> None:
    told: list[Progress] = []
    engine = NoWorker()

    async def main() -> object:
        waiting = asyncio.ensure_future(analysis_with(engine, tmp_path).followed(told.append, abs))
        await asyncio.sleep(0)
        for share, text in ((0.25, "reading"), (0.5, "fitting"), (7.0, "beyond")):
            while not hasattr(engine, "file"):
                await asyncio.sleep(0.001)
            engine.file.write(Progress(share, stage=text))
            while Progress(min(share, 1.0), stage=text) not in told:
                await asyncio.sleep(0.001)
        engine.file.write(Progress(0.75, stage="at the end"))
        engine.work.set_result("done")
        return await waiting

    assert asyncio.run(main()) == "done"
    assert [(one.share, one.stage) for one in dict.fromkeys(told)] == [
        *((0.25, "reading"), (0.5, "fitting"), (1.0, "beyond")),
        (0.75, "at the end"),
    ]
    assert list(tmp_path.iterdir()) == []


def test_who_stops_waiting_stops_the_work(tmp_path: Path) -> None:
    engine = NoWorker()

    async def main() -> None:
        following = analysis_with(engine, tmp_path).followed(lambda *_: None, abs)
        waiting = asyncio.create_task(following)
        await asyncio.sleep(0.02)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        await asyncio.sleep(0.01)

    asyncio.run(main())
    assert engine.work.cancelled()


def test_what_fails_fails_where_it_is_waited_for(tmp_path: Path) -> None:
    engine = NoWorker()
    engine.work.set_exception(ValueError("no"))
    following = analysis_with(engine, tmp_path).followed(lambda *_: None, abs)
    with pytest.raises(ValueError, match="no"):
        asyncio.run(following)


def test_what_is_no_progress_is_passed_over(tmp_path: Path) -> None:
    file = ProgressFile(tmp_path / "progress")
    assert file.read() is None
    for content in ("", "[0.5", "[]", "{}", "3", '["a", "b"]', "[" * 100_000):
        (tmp_path / "progress").write_text(content)
        assert file.read() is None, content


def test_a_stage_is_told_at_once_and_its_shares_now_and_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_LEAST_SECONDS", 60.0)
    file = ProgressFile(tmp_path / "progress")
    for share in (0.1, 0.2, 0.3):
        file.write(Progress(share))
    assert file.read() == Progress(0.1)
    file.write(Progress(0.4, stage="fitting"))
    assert file.read() == Progress(0.4, stage="fitting")


def test_encoding_tells_how_far_it_is(tmp_path: Path) -> None:
    kept, output, progress = (tmp_path / name for name in ("kept", "output", "progress"))
    coarse = simulate_ventricle(grid=(8, 16), rng=np.random.default_rng(1))
    kept.write_bytes(sequence_to_hdf5(coarse))
    shares: list[float] = []

    class Noted(ProgressFile):
        def write(self, progress: Progress) -> None:
            shares.append(progress.share)
            super().write(progress)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sequences, "ProgressFile", Noted)
        sequences.encode_sequence(kept, EncodingTarget(rms=0.5), output, progress)
    assert shares == sorted(shares)
    assert any(0.0 < share < 1.0 for share in shares)
    assert ProgressFile(progress).read() == Progress(1.0, stage="encoding")
