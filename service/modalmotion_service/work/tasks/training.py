"""What a worker does to train a model. Like every task it carries paths and may run twice."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modalmotion.classification import CaseFile, Model, TrainingCase, TrainingOptions, train
from modalmotion.classification.training import joblib_backend
from modalmotion.errors import ModalMotionError, ParameterError
from modalmotion.progress import part_of
from modalmotion.store import kept_model, model_to_hdf5
from modalmotion_service.errors import ClusterError
from modalmotion_service.work.tasks.files import ProgressFile


@dataclass(frozen=True)
class Unfitted:
    """A case that the training goes on without: its signature could not be made."""

    name: str
    reason: str

    def read(self) -> TrainingCase:
        """Raise what is wrong with it."""
        raise ParameterError(f"{self.name}: {self.reason}")


Cases = list[CaseFile | Unfitted]


def train_model(
    cases: Cases,
    normal_displacements: Cases | None,
    name: str,
    options: dict[str, Any],
    training: str,
    image: Path,
    scheduler: str | None,
    n_threads: int,
    progress: Path,
) -> int:
    """Train a model on kept signatures and write its HDF5 image; gives the number of cases in it.

    Parameters
    ----------
    cases : list of CaseFile or Unfitted
    normal_displacements : list of CaseFile or Unfitted, or None
        The same by their normal displacements, where both kinds are weighed.
    name : str
    options : dict
        As `TrainingOptions.as_json` gives them.
    training : str
        Name of this training, which is kept with the model.
    image : Path
        Written at the end.
    scheduler : str or None
        Whose workers read the signatures and fit the folds; else this process does.
    n_threads : int
        Of this process. It may have no children of its own.
    progress : Path
        Where `ProgressFile` tells how far it is.

    Raises
    ------
    ModalMotionError
        If no model can be trained on them.
    ClusterError
        If the scheduler or its workers are lost.
    """
    report = part_of(ProgressFile(progress).write, 0.0, 1.0, "training")
    chosen = TrainingOptions.from_json(options)

    def work() -> Model:
        return train(cases, name, chosen, report, normal_displacements=normal_displacements)

    if scheduler is not None:
        model = _on_workers(work, scheduler)
    else:
        with joblib_backend(n_jobs=n_threads, threads=True):
            model = work()
    image.write_bytes(model_to_hdf5(kept_model(model, training=training)))
    return sum(model.card.n_cases.values())


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
