"""What a worker does to train a model. Like every task it carries paths and may run twice."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from modalmotion.classify import TrainingCase, TrainingOptions, train
from modalmotion.errors import ModalMotionError
from modalmotion.store import kept_model, model_to_hdf5, signature_from_hdf5


def train_model(
    plan: Path, name: str, options: dict[str, Any], training: str, image: Path, progress: Path
) -> None:
    """Train a model on kept signatures and write its HDF5 image.

    Parameters
    ----------
    plan : Path
        A line of JSON for each case: `id`, `label`, `subject` and the `path` of its signature.
    name : str
    options : dict
        As `TrainingOptions.as_json` gives them.
    training : str
        Name of this training, which is kept with the model.
    image : Path
        Written at the end.
    progress : Path
        Written over and over; see `read_progress`.
    """
    beside = progress.with_name(f"{progress.name}.new")

    def report(share: float, text: str) -> None:
        # Renamed into place, so that it is never read half-written.
        beside.write_text(json.dumps([share, text]))
        beside.replace(progress)

    cases = _Cases(plan)
    try:
        model = train(cases, name, TrainingOptions.from_json(options), report)
    except ModalMotionError as error:
        raise _naming(error, cases.under_way) from error
    image.write_bytes(model_to_hdf5(kept_model(model, training=training)))


def read_progress(progress: Path) -> tuple[float, str]:
    """Share that a training has done, 0 to 1, and what it does now."""
    try:
        share, text = json.loads(progress.read_text())
    except FileNotFoundError:
        return 0.0, "training"
    return min(max(float(share), 0.0), 1.0), str(text)


class _Cases:
    """Cases of a plan, their signatures read one by one, and the one that is in use."""

    def __init__(self, plan: Path) -> None:
        self._plan = plan
        self.under_way: str | None = None
        with plan.open() as lines:
            self._n_cases = sum(1 for _ in lines)

    def __len__(self) -> int:
        return self._n_cases

    def __iter__(self) -> Iterator[TrainingCase]:
        with self._plan.open() as lines:
            for line in lines:
                case = json.loads(line)
                self.under_way = case["id"]
                signature = signature_from_hdf5(Path(case["path"]))
                yield TrainingCase(signature, case["label"], case["subject"])
        self.under_way = None


def _naming(error: ModalMotionError, sequence_id: str | None) -> ModalMotionError:
    if sequence_id is None:
        return error
    named = copy.copy(error)
    named.details = {**error.details, "sequence_id": sequence_id}
    return named
