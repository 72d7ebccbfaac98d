"""Memory under load: bounded while it lasts, and given back."""

from __future__ import annotations

import statistics
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from running import RunningService

import modalmotion as mm
from modalmotion.client import Client, RemoteError, Retries
from modalmotion_service.commands.server import KEPT_BYTES

N_WORKERS = 2
GRID = (130, 128)


@pytest.fixture
def service(tmp_path: Path) -> Iterator[RunningService]:
    running = RunningService(tmp_path / "results", {"WORKERS": str(N_WORKERS)})
    yield running.start()
    running.stop()


@contextmanager
def peak_of(service: RunningService) -> Iterator[list[int]]:
    """Watch the memory of all processes; the list holds what was seen."""
    seen, ended = [service.memory()], threading.Event()

    def watch() -> None:
        while not ended.wait(0.01):
            seen.append(service.memory())

    watching = threading.Thread(target=watch)
    watching.start()
    try:
        yield seen
    finally:
        ended.set()
        watching.join()


@cache
def large_ones() -> list[mm.MeshSequence]:
    """100 frames of a ventricle and of a larger one, 20 MB each as float32."""
    acquisition = mm.Acquisition(n_frames=100)
    rng = np.random.default_rng(0)
    beat = mm.simulate_ventricle(grid=GRID, acquisition=acquisition, rng=rng)
    return [
        mm.mesh_sequence(
            (size * beat.vertices).astype(np.float32), grid=GRID, topology="cup", unit="mm"
        )
        for size in (1.0, 1.1)
    ]


RAW: dict[str, Any] = {"format": "raw", "grid": GRID, "topology": "cup", "unit": "mm"}


def bodies_in_memory(
    service: RunningService,
    n_at_once: int,
    call: Callable[[Client, int], object],
    size: int,
    limit: float,
) -> float:
    """Peak above idle while requests are under way, in bodies a request.

    A busy machine lets other peaks coincide: the first of three within the limit counts.
    """
    with Client(service.base) as client, ThreadPoolExecutor(n_at_once) as threads:
        # Everything is imported and the small things are cached before it is measured.
        small = mm.simulate_ventricle(rng=np.random.default_rng(1))
        list(threads.map(lambda _: client.signature_of(small), range(2 * N_WORKERS)))
        idle, found = service.memory(), list[float]()
        while len(found) < 3 and min(found, default=np.inf) > limit:
            with peak_of(service) as seen:
                list(threads.map(lambda k: call(client, k), range(2 * n_at_once)))
            found.append((max(seen) - idle) / (n_at_once * size))
    return min(found)


@pytest.mark.every(3)
@pytest.mark.parametrize(
    "kind",
    ["signature of raw", "upload of npz", pytest.param("upload of raw", marks=pytest.mark.soak)],
)
def test_uploads_of_20_mb_take_at_most_four_bodies_each(
    service: RunningService, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    sequences = large_ones()
    raws = [sequence.vertices.tobytes() for sequence in sequences]
    size = len(raws[0])
    assert 19e6 < size < 21e6

    def call(client: Client, number: int) -> object:
        if kind == "signature of raw":
            return client.signature_of(raws[number % 2], **RAW)
        if kind == "upload of raw":
            return client.upload(raws[number % 2], label=str(number % 2), **RAW)
        return client.upload(sequences[number % 2])

    found = bodies_in_memory(service, N_WORKERS, call, size, 4.0)
    with capsys.disabled():
        print(f"\n{kind}, {N_WORKERS} at once: {found:.2f} bodies a request")  # noqa: T201
    assert found <= 4.0


def mixed_load(service: RunningService, seconds: float, n_clients: int = 4) -> list[dict[int, int]]:
    """Everything at once for a while; memory of each process, ten times a second."""
    end = time.monotonic() + seconds
    seen: list[dict[int, int]] = []

    def work(seed: int) -> None:
        rng = np.random.default_rng(seed)
        with Client(service.base, retries=Retries(rng=rng)) as client:
            while time.monotonic() < end:
                beat = mm.simulate_ventricle(
                    grid=(16, 32), acquisition=mm.Acquisition(noise=0.5), rng=rng
                )
                info = client.upload(beat, subject=f"S{rng.integers(20)}")
                client.signature(info.id, modes=int(rng.choice([4, 7, 18])))
                client.signature_of(beat)
                client.start_signature(info.id, modes=11).wait()
                client.classify(info.id)
                client.decode(client.encode(beat, rms=0.5).data)
                client.reconstruction(info.id)
                with pytest.raises(RemoteError):
                    client.upload(b"nothing that is understood")
                with pytest.raises(RemoteError):
                    client.signature(info.id, modes=2000)
                for _, one in zip(range(5), client.sequences(page=5), strict=False):
                    assert one.id
                client.delete(info.id)

    with ThreadPoolExecutor(n_clients) as threads:
        working = [threads.submit(work, seed) for seed in range(n_clients)]
        while time.monotonic() < end:
            time.sleep(0.1)
            seen.append(service.memories())
        for one in working:
            one.result()
    return seen


@pytest.mark.thorough
def test_mixed_load_is_served_and_its_memory_is_bounded(service: RunningService) -> None:
    seen = mixed_load(service, 0.5, n_clients=2)
    # A short run cannot tell growth from warming up; it holds that all of it works at once.
    assert max(sum(one.values()) for one in seen) < 1_500_000_000
    assert not list((service.data_dir / "spool").iterdir())


@pytest.mark.soak
def test_ten_minutes_of_mixed_load_grow_by_less_than_three_per_cent(
    service: RunningService,
) -> None:
    seen = mixed_load(service, 600.0)
    # After three minutes workers hold what they may keep of freed memory (`keep_freed_memory`), and
    # the server its pages of the index; the server takes what it may keep sooner or later. A leak
    # goes on.
    minute = len(seen) // 10
    fourth, last = seen[3 * minute : 4 * minute], seen[-minute:]
    before, after = (
        statistics.median(sum(one.values()) for one in part) for part in (fourth, last)
    )
    growth = (after - KEPT_BYTES) / before - 1
    print(  # noqa: T201
        f"memory of the fourth minute {before / 1e6:.1f} MB, of the last {after / 1e6:.1f} MB: "
        f"{100 * growth:+.2f} % beyond what the server may keep"
    )
    for pid in last[-1]:
        each = [statistics.median(one.get(pid, 0) for one in part) / 1e6 for part in (fourth, last)]
        print(f"process {pid}: {each[0]:.1f} and {each[1]:.1f} MB")  # noqa: T201
    assert growth < 0.03
    assert not list((service.data_dir / "spool").iterdir())
