"""A Dask worker in this process, which waits for its scheduler for ever."""

from __future__ import annotations

import asyncio
import logging
import logging.config
import signal
import tempfile
from typing import Any, Final

import dask
from distributed import Worker

from modalmotion_service.environment import read_settings
from modalmotion_service.log_lines import log_config
from modalmotion_service.work.dask.logs import log_dask_as_json
from modalmotion_service.work.parsing import say_whether_confined

logger = logging.getLogger(__name__)

# Dask looks a hundred times a second at what its threads do, and ticks fifty times, which takes
# 3 % of a core from tasks; ours run in other processes, where it sees nothing of them. What an
# operator sets in Dask's own way counts more.
_DEFAULTS: Final[dict[str, Any]] = {
    "distributed": {
        "worker": {"profile": {"enabled": False}},
        "admin": {"tick": {"interval": "500ms"}},
    }
}


async def work_for(scheduler: str, n_processes: int, host: str | None) -> None:
    """Work for a scheduler until SIGTERM or Ctrl-C; when it is lost, look for it again.

    Parameters
    ----------
    scheduler : str
        Address such as tcp://host:8786.
    n_processes : int
        Tasks at once, each in a process of its own; one more does short work alone.
    host : str or None
        Address of this machine by which the scheduler and other workers reach it.
    """
    dask.config.update_defaults(_DEFAULTS)
    logging.config.dictConfig(log_config(read_settings().log_level))
    log_dask_as_json()
    say_whether_confined()
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    with tempfile.TemporaryDirectory(prefix="modalmotion-worker-") as folder:
        while not stop.is_set():
            stopping = asyncio.create_task(stop.wait())
            working = asyncio.create_task(_work(scheduler, n_processes, host, folder))
            await asyncio.wait([stopping, working], return_when=asyncio.FIRST_COMPLETED)
            stopping.cancel()
            working.cancel()
            (outcome,) = await asyncio.gather(working, return_exceptions=True)
            if isinstance(outcome, OSError):
                logger.warning("no scheduler at %s: %s", scheduler, outcome)
                await asyncio.sleep(1.0)
            elif isinstance(outcome, Exception):
                raise outcome


async def _work(scheduler: str, n_processes: int, host: str | None, folder: str) -> None:
    worker = Worker(
        scheduler,
        # And one that no long task takes.
        nthreads=n_processes + 1,
        # Work is done in processes of a pool, which limit their memory themselves.
        memory_limit=0,
        host=host,
        dashboard=False,
        local_directory=folder,
    )
    try:
        await worker
        logger.info("at work for %s, %d tasks at once", scheduler, n_processes)
        await worker.finished()
    finally:
        await worker.close(timeout=5, nanny=False)
