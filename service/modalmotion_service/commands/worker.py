"""The command that works for a scheduler."""

from __future__ import annotations

import asyncio
import os

import click

from modalmotion.cli.options import example
from modalmotion.errors import needs_extra


@click.command(epilog=example("worker tcp://scheduler:8786 --processes 2"))
@click.argument("scheduler", metavar="ADDRESS")
@click.option(
    "--processes",
    default=lambda: os.cpu_count() or 1,
    type=click.IntRange(1, 256),
    help="Tasks at once, each in a process of its own  [default: number of cores].",
)
@click.option("--host", help="Address of this machine for the scheduler and other workers.")
def worker(scheduler: str, processes: int, host: str | None) -> None:
    """Work for the Dask scheduler at ADDRESS, such as tcp://host:8786.

    The data folder of the service (or of the cohort) must lie under the same path here. When
    the scheduler is lost, the worker waits for it to return.
    """
    # As the service does: what is written here is as much its users' data.
    os.umask(0o077)
    with needs_extra("cluster"):
        from modalmotion_service.work.dask.worker import work_for
    asyncio.run(work_for(scheduler, processes, host))
