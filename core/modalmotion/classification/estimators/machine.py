"""Estimators that are not plain arrays, stored by skops: no pickle, and a constant allow-list."""

from __future__ import annotations

import zipfile
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import CorruptFileError

ALLOWED: Final = (
    "modalmotion.classification.estimators.estimator.MotionClassifier",
    "sklearn.tree._tree.Tree",
)
"""Types that a file may hold beyond those of numpy and scikit-learn, which skops trusts."""

# A forest over 10,000 cases is about this large.
_LARGEST: Final = 256 * 2**20


def machine_to_bytes(estimator: Any) -> bytes:
    """Write a fitted `MotionClassifier`."""
    from skops.io import dumps

    written: bytes = dumps(estimator, compression=8)
    return written


@lru_cache(maxsize=4)
def machine_from_bytes(data: bytes) -> Any:
    """Read an estimator from the bytes of `machine_to_bytes`.

    Raises
    ------
    CorruptFileError
        If it is damaged, or holds a type that is not allowed.
    """
    from skops.io import get_untrusted_types, loads

    from modalmotion.classification.estimators.estimator import MotionClassifier

    if len(data) > _LARGEST:
        raise CorruptFileError("The estimator is too large to be one.", remedy="Train it again.")
    unknown: list[str] = []
    try:
        unknown = sorted(set(get_untrusted_types(data=data)) - set(ALLOWED))
        estimator = None if unknown else loads(data, trusted=list(ALLOWED))
    except (zipfile.BadZipFile, OSError, ValueError, KeyError, TypeError) as error:
        raise CorruptFileError(
            "The model's estimator cannot be read.", remedy="Fetch the file again."
        ) from error
    except (AttributeError, ImportError, RuntimeError, NotImplementedError) as error:
        raise CorruptFileError(
            "The model's estimator does not fit this version of the package.",
            remedy="Train it again.",
        ) from error
    if unknown:
        raise CorruptFileError(
            f"The model holds the type {unknown[0]}, which no model of this package holds.",
            remedy="Use models that this package has written.",
            details={"types": unknown},
        )
    if not isinstance(estimator, MotionClassifier):
        raise CorruptFileError(
            "The model's estimator is not a motion classifier.", remedy="Train it again."
        )
    return estimator


def machine_log_shares(data: bytes, features: NDArray[np.float64]) -> NDArray[np.float64]:
    """Log probabilities, (cases, classes) float64, of features (cases, features)."""
    shares = machine_from_bytes(data).predict_proba(features)
    logs: NDArray[np.float64] = np.log(np.maximum(shares, 1e-12))
    return logs
