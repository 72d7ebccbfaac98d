"""Signatures that tests store over HTTP."""

from __future__ import annotations

from typing import Any

from fastapi.testclient import TestClient


def signed(client: TestClient, sequence: str, **parameters: Any) -> str:
    """Store a signature of a sequence, by its id or its link; gives the signature's link."""
    sequence_id = sequence.rpartition("/")[2]
    answer = client.post(f"/v1/sequences/{sequence_id}/signatures", json=parameters)
    assert answer.status_code in (200, 201), answer.text
    return str(answer.headers["location"])
