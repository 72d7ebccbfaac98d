"""Models: listing, description, training, deletion; and their answers for a sequence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from modalmotion.client.answers import ClassAnswer, ModelInfo, value_of
from modalmotion.client.bodies import Source, body_of, json_body
from modalmotion.client.calls import (
    CSV,
    HDF5,
    JSON,
    MARKDOWN,
    PNG,
    Calls,
    require_suffix,
    save,
    sequence_path,
)
from modalmotion.client.connection import Answer, Call
from modalmotion.client.errors import understood
from modalmotion.client.jobs import Job
from modalmotion.client.many_files import SentResult, results_in
from modalmotion.client.query import Option, plain, segment
from modalmotion.progress import Progress

MODEL_FILES: Final = {".h5": HDF5, ".hdf5": HDF5, ".png": PNG, ".csv": CSV, ".md": MARKDOWN}
"""Media types of model files by suffix: the model, its card drawn or written, held-out answers."""

EVALUATION_FILES: Final = {".png": PNG, ".csv": CSV}

Case = str | Mapping[str, Any]
"""The id of a stored sequence, or its id, label, subject and covariates."""


class ModelCalls(Calls):
    """Models, and their answers for sequences."""

    def models(self, *, page: int = 100) -> Iterator[ModelInfo]:
        """List models by name, each in its newest version, fetched a page at a time."""
        members = self._pages("/v1/models", "models", limit=page)
        return (value_of(ModelInfo, member) for member in members)

    def model(self, name: str, version: int | None = None) -> ModelInfo:
        """Describe a version of a model, the newest by default; `answer["card"]` is its card."""
        return _model(self._get(_path(name, version)))

    def save_model(self, name: str, path: str | Path, version: int | None = None) -> None:
        """Write a model to .h5, as `mm.load_model` reads it; a picture of its card to .png.

        Or its card as a page to .md, and to .csv the answers to its training cases, each held out.
        """
        target = Path(path)
        accept = require_suffix(target, MODEL_FILES)
        save(self._get(_path(name, version), accept=accept).content, target)

    def train(
        self,
        name: str,
        cases: Iterable[Case],
        *,
        progress: Callable[[float], None] | None = None,
        **options: Option,
    ) -> ModelInfo:
        """Train a model on stored sequences: the next version of its name.

        Parameters
        ----------
        name : str
        cases : iterable of str or mapping
            Ids of stored sequences, whose labels, subjects and covariates count; or mappings with
            the members id, label, subject and covariates.
        progress : callable, optional
            Called with the share that is done, 0 to 1.
        **options
            Such as modes, coverage: see `/docs`.

        Raises
        ------
        RemoteError
            If the cases cannot be trained on.
        """
        return self._awaited(_training(name, cases, options), _model, progress)

    def start_training(self, name: str, cases: Iterable[Case], **options: Option) -> Job[ModelInfo]:
        """Start a training as `train` does, and do not wait for it."""
        return self._started(_training(name, cases, options), _model)

    def evaluate(
        self,
        name: str,
        cases: Iterable[Case],
        *,
        version: int | None = None,
        coverage: float = 0.9,
        progress: Callable[[float], None] | None = None,
    ) -> dict[str, Any]:
        """Test a version of a model, the newest by default, on stored, labelled sequences.

        Parameters
        ----------
        name : str
        cases : iterable of str or mapping
            As for `train`, of subjects that the model was not trained on.
        version : int, optional
        coverage : float
            Level of the class sets.
        progress : callable, optional
            Called with the share that is done, 0 to 1.

        Returns
        -------
        dict
            accuracy, auc, log_loss, sensitivity, cases (the answer to each) and so on: see `/docs`.
        """
        if version is None:
            version = self.model(name).version
        request = {"sequences": _listed(cases), "coverage": coverage}
        path = f"{_path(name, version)}/evaluations"
        call = Call("POST", path, body=json_body(request), is_repeatable=True)
        return self._awaited(call, _object, progress)

    def save_evaluation(
        self, name: str, cases: Iterable[Case], path: str | Path, *, version: int | None = None
    ) -> None:
        """Write a test of a model: the answers by case to .csv, a picture to .png."""
        target = Path(path)
        accept = require_suffix(target, EVALUATION_FILES)
        if version is None:
            version = self.model(name).version
        body = json_body({"sequences": _listed(cases)})
        route = f"{_path(name, version)}/evaluations"
        call = Call("POST", route, accept=accept, body=body, is_repeatable=True)
        save(self._awaited(call, lambda answer: answer).content, target)

    def compare_models(
        self,
        first: str,
        second: str,
        cases: Iterable[Case],
        *,
        coverage: float = 0.9,
        progress: Callable[[float], None] | None = None,
    ) -> dict[str, Any]:
        """Compare two models, each "name" or "name@version", on the same labelled sequences.

        Returns
        -------
        dict
            Of each figure first, second, difference, low, high and p: see `/docs`.
        """
        request = {"models": [first, second], "sequences": _listed(cases), "coverage": coverage}
        call = Call("POST", "/v1/models/comparisons", body=json_body(request), is_repeatable=True)
        return self._awaited(call, _object, progress)

    def delete_model(self, name: str, version: int) -> None:
        """Delete a version of a model; its number is never used again."""
        self._connection.send(Call("DELETE", _path(name, version)))

    def classify(
        self,
        sequence_id: str,
        *,
        covariates: Mapping[str, float | str] | None = None,
        **options: Option,
    ) -> ClassAnswer:
        """Ask a model for the class of a stored sequence's motion.

        Parameters
        ----------
        sequence_id : str
        covariates : mapping of str to (float or str), optional
            Such as an age: over those stored with the sequence.
        **options
            Members of the request, such as model: the shipped one by default.
        """
        path = sequence_path(sequence_id, "classifications")
        request = plain(options)
        if covariates:
            request["covariates"] = dict(covariates)
        call = Call("POST", path, body=json_body(request), is_keyed=True)
        return self._awaited(call, _class)

    def classify_of(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> ClassAnswer:
        """Ask a model for the class of a sequence sent along; nothing is stored.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.
        **options
            Of reading (format, grid, unit, ...), facts=, and model, coverage.
        """
        call = Call("POST", "/v1/classify", options, body=body_of(source), is_repeatable=True)
        return self._sent(call, lambda answer: value_of(ClassAnswer, answer.json), progress)

    def classes_of(
        self,
        sources: Mapping[str, Source] | Iterable[Source],
        *,
        manifest: str | None = None,
        progress: Progress | None = None,
        **options: Option,
    ) -> list[SentResult[ClassAnswer]]:
        """Ask a model for the classes of many sequences sent along; nothing is stored.

        Parameters
        ----------
        sources : iterable of (path, bytes or MeshSequence), or mapping of str to these
        manifest : str, optional
            As of `signatures_of`.
        progress : callable, optional
            Called with the files that are done, and all.
        **options
            As of `classify_of`; of all files.
        """

        def read(answer: Answer) -> list[SentResult[ClassAnswer]]:
            return results_in(answer, "classification", lambda one: value_of(ClassAnswer, one))

        return self._of_many(("/v1/classify", JSON), sources, manifest, read, progress, options)

    def classifications(self, sequence_id: str) -> list[ClassAnswer]:
        """List the models' answers for a sequence."""
        answer = self._get(sequence_path(sequence_id, "classifications")).json
        with understood("a list of classifications"):
            return [value_of(ClassAnswer, member) for member in answer["classifications"]]


def _path(name: str, version: int | None) -> str:
    path = f"/v1/models/{segment(name)}"
    return path if version is None else f"{path}/versions/{version:d}"


def _training(name: str, cases: Iterable[Case], options: Mapping[str, Option]) -> Call:
    request: dict[str, Any] = {
        "name": name,
        "sequences": _listed(cases),
        "options": plain(options),
    }
    return Call("POST", "/v1/models", body=json_body(request), is_keyed=True)


def _listed(cases: Iterable[Case]) -> list[str | dict[str, Any]]:
    return [case if isinstance(case, str) else dict(case) for case in cases]


def _object(answer: Answer) -> dict[str, Any]:
    with understood("the figures of models"):
        return dict(answer.json)


def _model(answer: Answer) -> ModelInfo:
    return value_of(ModelInfo, answer.json)


def _class(answer: Answer) -> ClassAnswer:
    # A job's result is the list of all; this one is the newest of its model.
    listed = answer.json
    with understood("a list of classifications"):
        if isinstance(listed, dict) and "classifications" in listed:
            listed = listed["classifications"][-1]
    return value_of(ClassAnswer, listed)
