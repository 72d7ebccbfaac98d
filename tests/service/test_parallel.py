"""Cross-validation gives the same scores wherever joblib works."""

from __future__ import annotations

import os

import joblib
import numpy as np
import pytest
from dask_cluster import DaskCluster, free_port
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.model_selection import cross_val_score

from modalmotion.errors import ParameterError
from modalmotion.parallel import joblib_backend


def scores() -> np.ndarray:
    rng = np.random.default_rng(3)
    features = rng.normal(size=(90, 5))
    classes = np.arange(90) % 3
    features[:, 0] += classes
    scored: np.ndarray = cross_val_score(LinearDiscriminantAnalysis(), features, classes, cv=5)
    return scored


def where() -> set[int]:
    return set(joblib.Parallel()(joblib.delayed(os.getpid)() for _ in range(4)))


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


def test_a_scheduler_that_is_not_there_is_named() -> None:
    address = f"tcp://127.0.0.1:{free_port()}"
    with (
        pytest.raises(ParameterError, match="no scheduler"),
        joblib_backend(address, connect_seconds=0.5),
    ):
        raise AssertionError("not reached")
