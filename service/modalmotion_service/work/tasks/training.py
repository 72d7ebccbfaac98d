"""What a worker does to train a model. Like every task it carries paths and may run twice."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modalmotion.classification import CaseFile, Model, TrainingCase, TrainingOptions, train
from modalmotion.classification.cases import case_name
from modalmotion.classification.training import joblib_backend
from modalmotion.errors import ModalMotionError, ParameterError
from modalmotion.mesh import Named
from modalmotion.store import kept_model, model_to_hdf5
from modalmotion_service.errors import ClusterError
from modalmotion_service.work.task_progress import ProgressFile


def train_model(
    plan: Path,
    name: str,
    options: dict[str, Any],
    training: str,
    image: Path,
    progress: Path,
    scheduler: str | None = None,
    n_threads: int = 1,
) -> None:
    """Train a model on kept signatures and write its HDF5 image.

    Parameters
    ----------
    plan : Path
        A line of JSON for each case: `id`, `label`, `subject`, `covariates`, the `path` of its
        signature and, where both kinds are weighed, that of its `offsets`; or `left_out`, the
        reason why it has none.
    name : str
    options : dict
        As `TrainingOptions.as_json` gives them.
    training : str
        Name of this training, which is kept with the model.
    image : Path
        Written at the end.
    progress : Path
        Where `ProgressFile` tells how far it is.
    scheduler : str, optional
        Whose workers read the signatures and fit the folds; else this process does.
    n_threads : int
        Of this process. It may have no children of its own.

    Raises
    ------
    ModalMotionError
        If no model can be trained on them.
    ClusterError
        If the scheduler or its workers are lost.
    """
    report = ProgressFile(progress).write
    chosen = TrainingOptions.from_json(options)

    def work() -> Model:
        offsets = _Cases(plan, "offsets")
        return train(
            *(_Cases(plan), name, chosen, report), offsets=offsets if offsets.are_there else None
        )

    if scheduler is not None:
        model = _on_workers(work, scheduler)
    else:
        with joblib_backend(n_jobs=n_threads, threads=True):
            model = work()
    image.write_bytes(model_to_hdf5(kept_model(model, training=training)))


def _on_workers(
    work: Callable[[], Model], scheduler: str, *, connect_seconds: float = 30.0
) -> Model:
    with ExitStack() as stack:
        try:
            stack.enter_context(joblib_backend(scheduler, connect_seconds=connect_seconds))
        except ParameterError as error:
            raise ClusterError(error.message, remedy=error.remedy) from error
        try:
            return work()
        except ModalMotionError:
            raise
        except Exception as error:
            if not _is_of_dask(error):
                raise
            raise ClusterError(
                f"The workers of '{scheduler}' were lost during a training: {error}",
                remedy="Try again soon; an operator should look after the scheduler.",
            ) from error


def _is_of_dask(error: Exception) -> bool:
    from concurrent.futures import CancelledError

    from distributed import KilledWorker

    return isinstance(error, (OSError, TimeoutError, CancelledError, KilledWorker))


@dataclass(frozen=True)
class _Unfitted:
    """A case that the training goes on without: its signature could not be made."""

    name: str
    reason: str

    def read(self) -> TrainingCase:
        raise ParameterError(f"{self.name}: {self.reason}")


class _Cases:
    """Cases of a plan, line by line."""

    def __init__(self, plan: Path, which: str = "path") -> None:
        self._plan = plan
        self._which = which
        with plan.open() as lines:
            self._n_cases = sum(1 for _ in lines)

    @property
    def are_there(self) -> bool:
        """Whether the plan has such signatures."""
        with self._plan.open() as lines:
            return any(self._which in json.loads(line) for line in lines)

    def __len__(self) -> int:
        return self._n_cases

    def __iter__(self) -> Iterator[CaseFile | _Unfitted]:
        with self._plan.open() as lines:
            for line in lines:
                case = json.loads(line)
                if "left_out" in case:
                    yield _Unfitted(case_name(case["id"]), case["left_out"])
                    continue
                yield CaseFile(
                    *(Path(case[self._which]), case["id"], case["label"], case["subject"]),
                    covariates=Named(case["covariates"]),
                )
