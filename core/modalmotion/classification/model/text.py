"""Models as files: JSON with arrays in it, no pickle, and checked on reading."""

from __future__ import annotations

import base64
import json
import zipfile
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.scorer import Blend, Scorer
from modalmotion.classification.features import Column, FeatureReader
from modalmotion.classification.model.card import ModelCard
from modalmotion.classification.model.conformal import Calibration
from modalmotion.classification.model.domain import Domain
from modalmotion.classification.model.model import Model, Readable, contents
from modalmotion.errors import CorruptFileError, InputError
from modalmotion.signature.making import SignatureParameters

SCHEMA: Final = 4

# The golden batch must come out as it was stored, but for the last digits.
_GOLDEN_TOLERANCE: Final = 1e-9

_LARGEST: Final = 512 * 2**20


def model_to_bytes(model: Model) -> bytes:
    """Write a model as JSON text: the same bytes for the same model."""
    kept = {"schema": SCHEMA, "id": model.id, **contents(model)}
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(value)}" for name, value in kept.items())
    return f"{{\n{lines}\n}}\n".encode()


def model_from_bytes(data: bytes) -> Model:
    """Read what `model_to_bytes` wrote.

    Raises
    ------
    CorruptFileError
        If it is no model, was altered, or predicts its golden batch differently here.
    """
    if len(data) > _LARGEST:
        raise CorruptFileError("The file is too large to be a model.", remedy="Name a model.")
    try:
        stored = json.loads(data)
        if stored["schema"] != SCHEMA:
            raise CorruptFileError(
                f"The model has schema {stored['schema']!r}, not {SCHEMA}.",
                remedy="Use the version of the package that wrote it, or train it again.",
            )
        found = str(stored["id"])
        model = _model(stored)
        _require_shapes(model)
        if model.id != found:
            raise CorruptFileError(
                f"The model {model.name[:80]!r} is not what was written: its sha256 is "
                f"{model.id[:12]}…, not {found[:12]}….",
                remedy="Fetch the file again.",
            )
        predicted = model.probabilities(model.golden_features)
    except (
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        IndexError,
        RecursionError,
        OverflowError,
        InputError,
        zipfile.BadZipFile,
    ) as error:
        raise CorruptFileError(
            "The file holds no model of this package.",
            remedy="Use a file written by `model_to_bytes`.",
        ) from error
    apart = np.abs(predicted - model.golden_probabilities).max(initial=0.0)
    if not apart <= _GOLDEN_TOLERANCE:
        raise CorruptFileError(
            f"The model {model.name[:80]!r} does not predict its golden batch as it did: a "
            f"probability is off by {apart:.2g}.",
            remedy="Train it again with this version of the package.",
        )
    return model


def _model(stored: Mapping[str, Any]) -> Model:
    reader, domain = dict(stored["reader"]), dict(stored["domain"])
    if reader["typical"] is not None:
        real, imaginary = _unpacked(reader["typical"])
        reader["typical"] = real + 1j * imaginary
    parameters = dict(stored["parameters"])
    del parameters["landmarks"]
    if parameters["grid"] is not None:
        parameters["grid"] = tuple(parameters["grid"])
    return Model(
        name=str(stored["name"]),
        classes=tuple(map(str, stored["classes"])),
        readable=Readable(
            topologies=tuple(map(str, stored["topologies"])),
            n_modes=int(stored["n_modes"]),
            connectivity_id=str(stored["connectivity_id"]),
            parameters=parameters_from(parameters),
        ),
        reader=FeatureReader(**reader),
        columns=tuple(
            Column(str(n), tuple(map(int, m)), float(power)) for n, m, power in stored["columns"]
        ),
        blend=Blend(
            centre=_unpacked(stored["centre"]),
            scale=_unpacked(stored["scale"]),
            scorers=tuple(
                Scorer(
                    anchors=_unpacked(s["anchors"]),
                    gamma=float(s["gamma"]),
                    weights=_unpacked(s["weights"]),
                    intercepts=_unpacked(s["intercepts"]),
                    temperature=float(s["temperature"]),
                )
                for s in stored["scorers"]
            ),
            temperature=float(stored["temperature"]),
        ),
        machine=base64.b64decode(stored["machine"], validate=True),
        domain=Domain(
            means=_unpacked(domain["means"]),
            whitening=_unpacked(domain["whitening"]),
            limit=float(domain["limit"]),
            least_motion=float(domain["least_motion"]),
            least_smooth=float(domain["least_smooth"]),
        ),
        calibration=Calibration(tuple(_unpacked(scores) for scores in stored["calibration"])),
        golden_features=_unpacked(stored["golden_features"]),
        golden_probabilities=_unpacked(stored["golden_probabilities"]),
        notes={str(label): tuple(texts) for label, texts in stored["notes"].items()},
        card=ModelCard.from_json(stored["card"]),
    )


def parameters_from(values: Mapping[str, Any]) -> SignatureParameters:
    """Signature parameters from their fields as JSON, landmarks left out."""
    from modalmotion.template import Weights
    from modalmotion.template.body_frame import Components

    known = dict(values)
    known["weights"] = Weights(known["weights"])
    known["components"] = Components(known["components"])
    return SignatureParameters(**known)


def _require_shapes(model: Model) -> None:
    """Check that the arrays fit together, so that no answer fails on a foreign file."""
    d, n = len(model.columns), len(model.classes)
    scorers = [(s.weights.shape, s.intercepts.shape, s.anchors.shape) for s in model.blend.scorers]
    expected = [((len(s.anchors) or d, n), (n,), (len(s.anchors), d)) for s in model.blend.scorers]
    shapes = (
        model.blend.centre.shape == model.blend.scale.shape == (d,),
        scorers == expected,
        bool(scorers) != bool(model.machine),
        model.domain.means.shape == (n, d + 1),
        model.domain.whitening.shape == (d + 1, d + 1),
        len(model.calibration.scores) == n >= 2,
        all(scores.ndim == 1 for scores in model.calibration.scores),
        model.golden_features.ndim == 2 and model.golden_features.shape[1] == d,
        model.golden_probabilities.shape == (len(model.golden_features), n),
    )
    if not all(shapes):
        raise ValueError("the arrays of the model do not fit together")


def _unpacked(stored: Mapping[str, Any]) -> NDArray[np.float64]:
    data = base64.b64decode(stored["float64"], validate=True)
    array = np.frombuffer(data, dtype="<f8").astype(np.float64)
    return array.reshape([int(n) for n in stored["shape"]])
