"""What a worker tells through a file reaches whoever waits for it."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest

from modalmotion.mesh.sequence import sequence_to_hdf5
from modalmotion.simulate import simulate_ventricle
from modalmotion_service.schemas.requests import EncodingTarget
from modalmotion_service.work.tasks import files, sequences
from modalmotion_service.work.tasks.files import ProgressFile, followed


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "_POLL_SECONDS", 0.005)
    monkeypatch.setattr(files, "_LEAST_SECONDS", 0.0)


def test_shares_are_told_in_their_order_until_the_work_is_done(tmp_path: Path) -> None:
    told: list[tuple[float, str]] = []
    path = tmp_path / "progress"

    async def work() -> str:
        file = ProgressFile(path)
        for share, text in ((0.25, "reading"), (0.5, "fitting"), (7.0, "beyond")):
            file.write(share, text)
            while (min(share, 1.0), text) not in told:
                await asyncio.sleep(0.001)
        return "done"

    assert asyncio.run(followed(work(), path, lambda *said: told.append(said))) == "done"
    assert list(dict.fromkeys(told)) == [(0.25, "reading"), (0.5, "fitting"), (1.0, "beyond")]


def test_all_is_told_of_work_that_is_done_at_once(tmp_path: Path) -> None:
    told: list[tuple[float, str]] = []
    path = tmp_path / "progress"
    ProgressFile(path).write(0.9, "of other work")

    async def work() -> None:
        file = ProgressFile(path)
        for share in (0.25, 0.5, 1.0):
            file.write(share, f"{share:.0%}")

    asyncio.run(followed(work(), path, lambda *said: told.append(said)))
    assert told == [(0.25, "25%"), (0.5, "50%"), (1.0, "100%")]


def test_the_first_share_is_told_however_soon_it_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_LEAST_SECONDS", 60.0)
    file = ProgressFile(tmp_path / "progress")
    for share in (0.0, 0.0, 0.1, 0.2, 1.0):
        file.write(share)
    assert file.news() == [(0.0, ""), (0.1, "")]


def test_half_a_line_waits_for_its_end_and_a_broken_one_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "progress"
    file = ProgressFile(path)
    assert file.news() == []
    path.write_text('[0.25, "reading"]\n[0.5')
    assert file.news() == [(0.25, "reading")]
    with path.open("a") as writer:
        writer.write(', "fitting"]\n[0.6, "wri[0.1, "again"]\n')
    assert file.news() == [(0.5, "fitting")]
    assert file.news() == []


def test_who_stops_waiting_stops_the_work(tmp_path: Path) -> None:
    ended: list[str] = []

    async def work() -> None:
        try:
            await asyncio.sleep(60)
        except asyncio.CancelledError:
            ended.append("cancelled")
            raise

    async def main() -> None:
        waiting = asyncio.create_task(followed(work(), tmp_path / "none", lambda *_: None))
        await asyncio.sleep(0.02)
        waiting.cancel()
        with pytest.raises(asyncio.CancelledError):
            await waiting
        await asyncio.sleep(0)

    asyncio.run(main())
    assert ended == ["cancelled"]


def test_what_fails_fails_where_it_is_waited_for(tmp_path: Path) -> None:
    async def work() -> None:
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        asyncio.run(followed(work(), tmp_path / "none", lambda *_: None))


def test_a_file_is_not_written_more_often_than_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "_LEAST_SECONDS", 60.0)
    file = ProgressFile(tmp_path / "progress")
    for share in (0.1, 0.2, 0.3):
        file.write(share)
    assert file.news() == [(0.1, "")]


def test_encoding_tells_how_far_it_is(tmp_path: Path) -> None:
    kept, output, progress = (tmp_path / name for name in ("kept", "output", "progress"))
    coarse = simulate_ventricle(grid=(8, 16), rng=np.random.default_rng(1))
    kept.write_bytes(sequence_to_hdf5(coarse))
    shares: list[float] = []

    class Noted(ProgressFile):
        def write(self, share: float, text: str = "") -> None:
            shares.append(share)
            super().write(share, text)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sequences, "ProgressFile", Noted)
        sequences.encode_sequence(kept, EncodingTarget(rms=0.5), output, progress)
    assert shares == sorted(shares)
    assert any(0.0 < share < 1.0 for share in shares)
    assert ProgressFile(progress).news()[-1] == (1.0, "encoding")
