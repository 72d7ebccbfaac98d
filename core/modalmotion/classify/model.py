"""Models as plain arrays: read without scikit-learn, without pickle, and checked on reading."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import CorruptFileError, NotFoundError
from modalmotion.signature import SignatureParameters

SCHEMA: Final = 1
DEFAULT_MODEL: Final = "ventricle-simulated"

# The golden batch must come out as it was stored, but for the last digits.
_GOLDEN_TOLERANCE: Final = 1e-9

_ARRAYS: Final = (
    "centre",
    "scale",
    "coefficients",
    "intercepts",
    "class_means",
    "whitening",
    "golden_features",
    "golden_probabilities",
)


@dataclass(frozen=True, eq=False)
class Model:
    """A linear classifier of motion features, with the domain it was trained in.

    Parameters
    ----------
    name : str
    classes : tuple of str
    feature_names : tuple of str
    topologies : tuple of str
        Names of the topologies whose signatures it reads.
    modes : int
        Number of modes of those signatures.
    centre, scale : (features,) float64
        Standardisation: z = (x - centre) / scale.
    coefficients : (classes, features) float64
    intercepts : (classes,) float64
        Log probabilities but for a constant: coefficients @ z + intercepts.
    class_means : (classes, features) float64
        Of z.
    whitening : (features, features) float64
        |whitening @ (z - mean)| is the distance in standard deviations within a class
        (Mahalanobis).
    farthest : float
        Distance from every class beyond which a motion is unlike any of the training.
    least_motion : float
        Deformation, as a share of the surface's size, below which nothing moves.
    least_periodic_share : float
        Below it a motion is noise.
    golden_features : (cases, features) float64
    golden_probabilities : (cases, classes) float64
        What the model must say of them.
    notes : dict of str to tuple of str
        What a user should know with every answer (under "") or with a class.
    card : dict
        How it was made and tested, and what it is for.
    """

    name: str
    classes: tuple[str, ...]
    feature_names: tuple[str, ...]
    topologies: tuple[str, ...]
    modes: int
    centre: NDArray[np.float64]
    scale: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    intercepts: NDArray[np.float64]
    class_means: NDArray[np.float64]
    whitening: NDArray[np.float64]
    farthest: float
    least_motion: float
    least_periodic_share: float
    golden_features: NDArray[np.float64]
    golden_probabilities: NDArray[np.float64]
    notes: dict[str, tuple[str, ...]]
    card: dict[str, Any]

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            getattr(self, name).setflags(write=False)

    @cached_property
    def id(self) -> str:
        """Identity: sha256 in hex of everything that an answer depends on."""
        contents = _contents(self)
        del contents["card"]
        text = json.dumps(contents, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def signature_parameters(self) -> SignatureParameters:
        """Parameters of the signatures it reads."""
        return SignatureParameters(modes=self.modes)

    def probabilities(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Probability of each class, (..., classes) float64, of features (..., features)."""
        scores = self._standardised(features) @ self.coefficients.T + self.intercepts
        scores -= scores.max(axis=-1, keepdims=True)
        shares: NDArray[np.float64] = np.exp(scores)
        shares /= shares.sum(axis=-1, keepdims=True)
        return shares

    def distance(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance to the nearest class, (...) float64, of features (..., features)."""
        apart = self._standardised(features)[..., None, :] - self.class_means
        distances: NDArray[np.float64] = np.linalg.norm(apart @ self.whitening.T, axis=-1)
        return np.asarray(distances.min(axis=-1))

    def _standardised(self, features: NDArray[np.float64]) -> NDArray[np.float64]:
        z: NDArray[np.float64] = (features - self.centre) / self.scale
        return z


def available_models() -> tuple[str, ...]:
    """Names of the models that come with the package, sorted."""
    folder = files(__package__) / "data"
    return tuple(
        sorted(file.name.removesuffix(".json") for file in folder.iterdir() if file.is_file())
    )


def load_model(which: str | Path = DEFAULT_MODEL) -> Model:
    """Load a model.

    Parameters
    ----------
    which : str or Path
        A str is the name of a model that comes with the package, and never a path, so that it
        may come from a stranger; a Path is a file written by `model_to_bytes`.

    Returns
    -------
    Model

    Raises
    ------
    NotFoundError
        If there is no such model.
    CorruptFileError
        If the file is no model, was altered, or predicts its golden batch differently here.
    """
    if isinstance(which, Path):
        try:
            return model_from_bytes(which.read_bytes())
        except OSError as error:
            raise NotFoundError(
                f"The model file {which.name!r} cannot be read: {error.strerror}.",
                remedy="Name an existing file.",
            ) from error
    if which not in available_models():
        raise NotFoundError(
            f"There is no model named {which[:80]!r}.",
            remedy=f"Use one of: {', '.join(available_models())}.",
        )
    return _load_shipped(which)


@cache
def _load_shipped(name: str) -> Model:
    return model_from_bytes((files(__package__) / "data" / f"{name}.json").read_bytes())


def model_to_bytes(model: Model) -> bytes:
    """Write a model as JSON text: the same bytes for the same model."""
    contents = {"schema": SCHEMA, "id": model.id, **_contents(model)}
    lines = ",\n".join(f"{json.dumps(name)}: {_rows(value)}" for name, value in contents.items())
    return f"{{\n{lines}\n}}\n".encode()


def model_from_bytes(text: bytes) -> Model:
    """Read what `model_to_bytes` wrote.

    Raises
    ------
    CorruptFileError
        If it is no model, was altered, or predicts its golden batch differently here.
    """
    try:
        stored = json.loads(text)
        if stored["schema"] != SCHEMA:
            raise CorruptFileError(
                f"The model has schema {stored['schema']!r}, not {SCHEMA}.",
                remedy="Use the version of the package that wrote it.",
            )
        found = stored["id"]
        arrays = {name: np.array(stored[name], dtype=np.float64) for name in _ARRAYS}
        model = Model(
            name=str(stored["name"]),
            classes=tuple(stored["classes"]),
            feature_names=tuple(stored["feature_names"]),
            topologies=tuple(stored["topologies"]),
            modes=int(stored["modes"]),
            centre=arrays["centre"],
            scale=arrays["scale"],
            coefficients=arrays["coefficients"],
            intercepts=arrays["intercepts"],
            class_means=arrays["class_means"],
            whitening=arrays["whitening"],
            farthest=float(stored["farthest"]),
            least_motion=float(stored["least_motion"]),
            least_periodic_share=float(stored["least_periodic_share"]),
            golden_features=arrays["golden_features"],
            golden_probabilities=arrays["golden_probabilities"],
            notes={label: tuple(texts) for label, texts in stored["notes"].items()},
            card=dict(stored["card"]),
        )
        predicted = model.probabilities(model.golden_features)
        reproduced = np.allclose(
            predicted, model.golden_probabilities, rtol=0.0, atol=_GOLDEN_TOLERANCE
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise CorruptFileError(
            "The file holds no model of this package.",
            remedy="Use a file written by `model_to_bytes`.",
        ) from error
    if model.id != found:
        raise CorruptFileError(
            f"The model {model.name!r} is not what was written: its sha256 is {model.id[:12]}…, "
            f"not {str(found)[:12]}….",
            remedy="Fetch the file again.",
        )
    if not reproduced:
        raise CorruptFileError(
            f"The model {model.name!r} does not predict its golden batch as it did.",
            remedy="Train it again with this version of the package.",
        )
    return model


def _contents(model: Model) -> dict[str, Any]:
    names = [name for name in Model.__dataclass_fields__ if name not in _ARRAYS]
    return {name: getattr(model, name) for name in names} | {
        name: getattr(model, name).tolist() for name in _ARRAYS
    }


def _rows(value: Any) -> str:
    """JSON with one line for each row of a matrix, which keeps changes readable."""
    if isinstance(value, list) and value and isinstance(value[0], list):
        return "[\n" + ",\n".join(json.dumps(row) for row in value) + "\n]"
    return json.dumps(value)
