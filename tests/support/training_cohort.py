"""A small cohort of simulated ventricles, sent to a service and trained on."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from fastapi.testclient import TestClient

from modalmotion.formats import write_npz
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle
from modalmotion.store import ResultStore

CLASSES = (MotionClass.NORMAL, MotionClass.HYPOKINESIA)


N_PER_CLASS = 6
# Where it does not matter how scores come about.
QUICK = {"repetitions": 1, "kind": "material"}


@dataclass(frozen=True)
class Sent:
    """A ventricle as a file, with what is said of it."""

    body: bytes
    label: str
    subject: str


def cohort(
    n_per_class: int, seed: int, classes: tuple[MotionClass, ...] = CLASSES
) -> Iterator[Sent]:
    """Coarse and short, so that fitting takes milliseconds."""
    rng = np.random.default_rng(seed)
    for number in range(n_per_class):
        for label in classes:
            sequence = simulate_ventricle(
                draw_parameters(label, rng),
                grid=(6, 12),
                acquisition=Acquisition(n_frames=10, noise=0.3),
                rng=rng,
            )
            yield Sent(write_npz(sequence), str(label), f"{label} {seed} {number}")


def send(client: Any, cases: Iterator[Sent]) -> list[str]:
    """Send a cohort with its labels and subjects; gives the ids."""
    ids = []
    for case in cases:
        params = {"label": case.label, "subject": case.subject}
        answer = client.post("/v1/sequences", content=case.body, params=params)
        assert answer.status_code in (200, 201), answer.text
        ids.append(answer.json()["id"])
    return ids


def finished(client: Any, job: dict[str, Any], seconds: float = 120.0) -> dict[str, Any]:
    """Wait for a job."""
    for _ in range(round(seconds / 0.02)):
        answer = client.get(job["links"]["self"]).json()
        if answer["state"] not in ("queued", "running"):
            return dict(answer)
        time.sleep(0.02)
    raise AssertionError(f"the job does not finish: {answer}")


def train(client: Any, name: str, ids: list[Any], **more: Any) -> dict[str, Any]:
    """Train a model to the end; gives the description of the new version."""
    answer = client.post("/v1/models", json={"name": name, "sequences": ids, **more})
    assert answer.status_code == 202, answer.text
    job = finished(client, answer.json())
    assert job["state"] == "succeeded", job["error"]
    return dict(client.get(job["result"]).json())


@dataclass
class Trained:
    """A service that has trained a model."""

    client: TestClient
    data_dir: Path
    ids: list[str]
    model: dict[str, Any]
    test: list[Sent]
    texts: list[str | None] = field(default_factory=list)

    @property
    def store(self) -> ResultStore:
        found: ResultStore = self.client.app.state.owners.local.store  # type: ignore[attr-defined]
        return found
