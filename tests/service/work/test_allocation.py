from __future__ import annotations

import ctypes
import gc
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from modalmotion_service.work.pool import WorkerPool


@pytest.fixture(scope="module")
def pool() -> Iterator[WorkerPool]:
    with WorkerPool(1, 60.0, 3_000_000_000) as pool:
        yield pool


def faults_of(work: Callable[[], object]) -> int:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    work()
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before


def use_and_free(n_times: int, n_bytes: int) -> None:
    for _ in range(n_times):
        arrays = [np.ones(n_bytes // 8) for _ in range(3)]
        del arrays


def faults_of_a_task_like_a_fit() -> int:
    use_and_free(3, 1_000_000)
    return faults_of(lambda: use_and_free(50, 1_000_000))


def resident_after_large_blocks() -> tuple[int, int]:
    before = _resident()
    use_and_free(3, 20_000_000)
    return before, _resident()


def frozen() -> int:
    return gc.get_freeze_count()


def _resident() -> int:
    pages = Path("/proc/self/statm").read_text().split()[1]
    return int(pages) * resource.getpagesize()


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallopt"), reason="this C library has no mallopt"
)
def test_a_worker_does_not_fetch_the_same_memory_again_and_again(pool: WorkerPool) -> None:
    # 22,800 where they are given back each time.
    assert pool.submit(faults_of_a_task_like_a_fit).result(timeout=30) < 2000


def test_a_worker_gives_large_blocks_back(pool: WorkerPool) -> None:
    before, after = pool.submit(resident_after_large_blocks).result(timeout=30)
    assert after - before < 20_000_000


def test_a_worker_does_not_walk_what_it_began_with(pool: WorkerPool) -> None:
    assert pool.submit(frozen).result(timeout=30) > 10_000


_OF_A_SERVER = """
import resource, threading
from modalmotion_service.work.worker import keep_freed_memory

def receive(n_times):
    for _ in range(n_times):
        pieces = [bytearray(1 << 18) for _ in range(4)]
        del pieces

def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

keep_freed_memory(4 << 20, in_one=True)
receive(3)
before = faults()
receive(50)
# What this thread has freed is another's.
thread = threading.Thread(target=receive, args=(50,))
thread.start()
thread.join()
print(faults() - before)
"""


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "mallopt"), reason="this C library has no mallopt"
)
def test_threads_of_a_server_share_what_it_keeps() -> None:
    done = subprocess.run([sys.executable, "-c", _OF_A_SERVER], capture_output=True, check=True)
    # 19,300 where they are given back each time.
    assert int(done.stdout) < 300
