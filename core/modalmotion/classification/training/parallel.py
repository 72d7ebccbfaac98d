"""Where joblib, and with it scikit-learn, does its work."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from modalmotion.errors import ParameterError, needs_extra


@contextmanager
def joblib_backend(
    scheduler: str | None = None,
    n_jobs: int = -1,
    *,
    threads: bool = False,
    connect_seconds: float = 30.0,
) -> Iterator[None]:
    """Have joblib work on a Dask scheduler's workers, or in processes or threads here.

    Whatever uses joblib inside the block and leaves its own `n_jobs` at None, such as
    cross-validation in scikit-learn, is shared out; results do not depend on where.

    Parameters
    ----------
    scheduler : str, optional
        Address such as tcp://host:8786; its workers need this package.
    n_jobs : int
        Pieces of work at once on this machine; -1 for as many as there are cores. On a
        scheduler its workers decide.
    threads : bool
        Threads in place of processes: in a worker of the service, whose memory is limited as a
        whole.
    connect_seconds : float

    Raises
    ------
    ParameterError
        If there is no such scheduler, or it has no workers.
    MissingExtraError
        If `distributed` is not installed.
    """
    import joblib

    if scheduler is None:
        with joblib.parallel_config("threading" if threads else "loky", n_jobs=n_jobs):
            yield
        return
    with needs_extra("cluster"):
        from distributed import Client
    try:
        client = Client(scheduler, set_as_default=False, timeout=connect_seconds)
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"There is no scheduler at '{scheduler}': {error}.",
            remedy="Start it, or correct the address.",
        ) from error
    with client:
        try:
            client.wait_for_workers(1, timeout=connect_seconds)
        except TimeoutError as error:
            raise ParameterError(
                f"The scheduler at '{scheduler}' has no workers.",
                remedy="Start some: dask worker ADDRESS --no-nanny.",
            ) from error
        with joblib.parallel_config("dask", client=client):
            yield
