"""Cross-validation and training give the same wherever joblib works."""

from __future__ import annotations

import os
from collections.abc import Iterable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import joblib
import numpy as np
import pytest
from dask_cluster import DaskCluster, free_port
from distributed import Client
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.model_selection import cross_val_score
from training_cohort import cohort

from modalmotion.classification import (
    CaseFile,
    Model,
    TrainingCase,
    TrainingOptions,
    model_to_hdf5,
    train,
)
from modalmotion.classification.training.parallel import joblib_backend
from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.formats import read_npz
from modalmotion.signature.making import modal_signature
from modalmotion.store import signature_to_hdf5
from modalmotion_service.errors import ClusterError
from modalmotion_service.work.tasks.training import _on_workers


def scores() -> np.ndarray:
    rng = np.random.default_rng(3)
    features = rng.normal(size=(90, 5))
    classes = np.arange(90) % 3
    features[:, 0] += classes
    scored: np.ndarray = cross_val_score(LinearDiscriminantAnalysis(), features, classes, cv=5)
    return scored


def where() -> set[int]:
    return set(joblib.Parallel()(joblib.delayed(os.getpid)() for _ in range(4)))


@pytest.mark.thorough
def test_processes_and_threads_give_the_scores_of_none() -> None:
    expected = scores()
    with joblib_backend(n_jobs=2):
        assert np.array_equal(scores(), expected)
        assert os.getpid() not in where()
    with joblib_backend(n_jobs=2, threads=True):
        assert np.array_equal(scores(), expected)
        assert where() == {os.getpid()}


def test_a_scheduler_gives_them_too(dask_cluster: DaskCluster) -> None:
    with joblib_backend(dask_cluster.address):
        assert np.array_equal(scores(), scores())
        elsewhere = where()
    assert elsewhere <= {worker.pid for worker in dask_cluster.workers}
    with joblib_backend(dask_cluster.address):
        inside = scores()
    assert np.array_equal(inside, scores())


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> list[CaseFile]:
    """Signatures in files, more than are read in one piece of work."""
    folder = tmp_path_factory.mktemp("signatures")
    found = []
    for number, sent in enumerate(cohort(12, seed=4)):
        sequence = read_npz(sent.body).sequence
        path = folder / f"{number}.h5"
        path.write_bytes(signature_to_hdf5(modal_signature(sequence)))
        found.append(CaseFile(path, sequence.id, sent.label, sent.subject))
    return found


QUICK = TrainingOptions(folds=3, estimator="linear", repetitions=2)


def trained(cases: Iterable[TrainingCase | CaseFile], options: TrainingOptions = QUICK) -> bytes:
    return model_to_hdf5(train(cases, "anywhere", options))


@pytest.mark.parametrize(
    "options",
    [
        replace(QUICK, repetitions=1, kind="material"),
        pytest.param(QUICK, marks=pytest.mark.soak),
        pytest.param(TrainingOptions(folds=3), marks=pytest.mark.soak),
    ],
)
def test_a_model_is_the_same_wherever_it_is_trained(
    options: TrainingOptions, cases: list[CaseFile], dask_cluster: DaskCluster
) -> None:
    here = trained(cases, options)
    # Read one by one beforehand, as a caller who has them in memory does.
    assert trained((case.read() for case in cases), options) == here
    for n_jobs, threads in ((2, True), (2, False)):
        with joblib_backend(n_jobs=n_jobs, threads=threads):
            assert trained(cases, options) == here
    with joblib_backend(dask_cluster.address):
        assert trained(cases, options) == here


def test_training_is_shared_out(cases: list[CaseFile], dask_cluster: DaskCluster) -> None:
    with Client(dask_cluster.address, set_as_default=False) as client:

        def n_done() -> int:
            streams = client.run(lambda dask_worker: dask_worker.state.executed_count)
            return sum(streams.values())

        before = n_done()
        with joblib_backend(dask_cluster.address):
            trained(cases)
            # Two pieces of cases, the whole, twice three folds, and as many of the learning curve.
            assert n_done() - before == 15


@pytest.mark.parametrize("threads", [None, 2])
def test_a_signature_that_is_gone_is_named(
    threads: int | None, cases: list[CaseFile], tmp_path: Path
) -> None:
    gone = replace(cases[20], path=tmp_path / "gone.h5")
    where = nullcontext() if threads is None else joblib_backend(n_jobs=threads, threads=True)
    with where, pytest.raises(NotFoundError) as caught:
        trained([*cases[:20], gone, *cases[21:]])
    assert caught.value.details["sequence_id"] == gone.sequence_id


def test_a_task_of_training_says_that_the_scheduler_is_lost(tmp_path: Path) -> None:
    address = f"tcp://127.0.0.1:{free_port()}"
    with pytest.raises(ClusterError, match="no scheduler"):
        _on_workers(lambda: pytest.fail("not reached"), address, connect_seconds=0.5)


@pytest.mark.soak
def test_a_scheduler_lost_in_the_middle_of_a_training_is_told(
    cases: list[CaseFile], tmp_path: Path
) -> None:
    cluster = DaskCluster(tmp_path / "dask").start(2)
    try:

        def report(_: float, text: str) -> None:
            # Everything is handed out, and nothing has come back.
            if text.startswith("fold 1 "):
                cluster.kill_scheduler()

        def work() -> Model:
            return train(cases, "lost", TrainingOptions(folds=3), report)

        with pytest.raises(ClusterError, match="lost during a training"):
            _on_workers(work, cluster.address, connect_seconds=5.0)
    finally:
        cluster.stop()


def test_a_scheduler_that_is_not_there_is_named() -> None:
    address = f"tcp://127.0.0.1:{free_port()}"
    with (
        pytest.raises(ParameterError, match="no scheduler"),
        joblib_backend(address, connect_seconds=0.5),
    ):
        raise AssertionError("not reached")
