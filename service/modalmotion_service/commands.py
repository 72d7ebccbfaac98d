"""Commands that the service adds to the command line."""

from __future__ import annotations

import asyncio
import os
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from modalmotion_service.errors import ClusterError


class _Later(click.Command):
    """A command that is imported when it is called, so that the help of all need not wait."""

    def __init__(self, module: str, name: str, line: str) -> None:
        super().__init__(name, short_help=line)
        self._module = module

    def make_context(
        self,
        info_name: str | None,
        args: list[str],
        parent: click.Context | None = None,
        **extra: Any,
    ) -> click.Context:
        """Hand over to the command itself."""
        found: click.Command = getattr(import_module(self._module), str(self.name))
        return found.make_context(info_name, args, parent, **extra)


keys = _Later(
    "modalmotion_service.access.key_commands",
    "keys",
    "Make, list and take back the keys that open a service.",
)
audit = _Later(
    "modalmotion_service.access.audit_commands",
    "audit",
    "Read, check and archive the record of who did what.",
)
owners = _Later(
    "modalmotion_service.access.owner_commands",
    "owners",
    "See what each owner has, and remove one with everything.",
)
cohort = _Later(
    "modalmotion_service.cohort.command",
    "cohort",
    "Sign every sequence of MANIFEST; go on where it was interrupted.",
)


@click.command()
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", default=8000, show_default=True, help="Port; 0 takes a free one.")
@click.option(
    "--data-dir",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder that results lie in  [default: MODALMOTION_DATA_DIR or modalmotion-data].",
)
def serve(host: str, port: int, data_dir: Path | None) -> None:
    """Start the HTTP service; its documentation is at /docs."""
    # Here, so that the help of all commands need not import the service.
    from modalmotion_service.environment import read_settings
    from modalmotion_service.server import run

    settings = read_settings() if data_dir is None else read_settings(data_dir=data_dir)
    run(settings, host, port)


@click.command()
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
    try:
        from modalmotion_service.dask_worker import work_for
    except ImportError as error:
        raise ClusterError(
            "A worker needs `distributed`.", remedy="Install modalmotion[service,cluster]."
        ) from error
    asyncio.run(work_for(scheduler, processes, host))
