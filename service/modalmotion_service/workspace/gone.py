"""The answer to a request that is sent again after its result was deleted."""

from __future__ import annotations

import base64
import json

from modalmotion.errors import NotFoundError
from modalmotion_service.http.problems import problem_body


def gone() -> tuple[int, dict[str, object]]:
    """Give status and stored answer."""
    body = problem_body(
        NotFoundError(
            "The result of this request has been deleted since.",
            remedy="Send it with a new Idempotency-Key to have it again.",
        )
    )
    text = base64.b64encode(json.dumps(body).encode()).decode("ascii")
    status = body["status"]
    assert isinstance(status, int)  # noqa: S101 (as `problem_body` makes it)
    return status, {"body": text, "headers": {"content-type": "application/problem+json"}}
