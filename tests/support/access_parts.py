"""A service that needs keys, and keys for it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient
from norm_controls import beat

from modalmotion.classification import load_model
from modalmotion.norm import train_norm
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

NOBODYS = {
    "sequence_id": "0" * 64,
    "template_id": "0" * 64,
    "track_id": "0" * 64,
    "images_id": "0" * 64,
    "job_id": "0" * 32,
    "name": "nobodys",
    "key": f"{'0' * 64}-{'0' * 16}",
}


@dataclass
class Guarded:
    """A service with keys, asked as one owner or another."""

    client: TestClient
    data_dir: Path
    tokens: dict[tuple[str, frozenset[Scope]], str] = field(default_factory=dict)

    def token(self, owner: str, *scopes: Scope) -> str:
        wanted = owner, frozenset(scopes or Scope)
        if wanted not in self.tokens:
            with KeyRing(self.data_dir) as ring:
                self.tokens[wanted] = ring.create(*wanted)[1]
        return self.tokens[wanted]

    def ask(self, owner: str, method: str, path: str, *scopes: Scope, **more: Any) -> Any:
        headers = {"Authorization": f"Bearer {self.token(owner, *scopes)}"}
        headers.update(more.pop("headers", {}))
        return self.client.request(method, path, headers=headers, **more)

    def keep_model(self, owner: str, name: str) -> None:
        """Keep a model for an owner who has asked before, without training one."""
        store = self.client.app.state.owners.states[owner].store  # type: ignore[attr-defined]
        store.put_model(replace(load_model(), name=name))

    def keep_norm(self, owner: str, name: str) -> None:
        """Keep a norm of nine controls for an owner who has asked before."""
        store = self.client.app.state.owners.states[owner].store  # type: ignore[attr-defined]
        store.put_norm(train_norm(map(beat, range(9)), name))


@contextmanager
def guarded(data_dir: Path, **settings: Any) -> Iterator[Guarded]:
    # No answer becomes a job because the machine is busy.
    chosen = {"workers": 1, "require_keys": True, "wait_seconds": 120.0, **settings}
    app = create_app(Settings(data_dir=data_dir, **chosen))
    with TestClient(app, raise_server_exceptions=False) as client:
        yield Guarded(client, data_dir)


def json_body(ids: list[str]) -> dict[str, Any]:
    return {"content": json.dumps({"ids": ids}), "headers": {"Content-Type": "application/json"}}
