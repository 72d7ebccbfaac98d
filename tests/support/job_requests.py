"""Requests that are left to a job, and the wait for its end."""

from __future__ import annotations

import time
from typing import Any

from fastapi.testclient import TestClient

ASYNC = {"Prefer": "respond-async"}


def finished(client: TestClient, job: dict[str, Any]) -> dict[str, Any]:
    for _ in range(1000):
        answer = client.get(job["links"]["self"])
        assert answer.status_code == 200
        if answer.json()["state"] not in ("queued", "running"):
            return dict(answer.json())
        assert answer.headers["retry-after"]
        time.sleep(0.02)
    raise AssertionError("the job does not finish")
