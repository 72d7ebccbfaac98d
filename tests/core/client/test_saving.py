"""Where a file cannot be written is said before anything is asked for."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from modalmotion.client import Client, Retries
from modalmotion.errors import StoreError

# What each wants besides the path.
ARGUMENTS: dict[str, Any] = {
    "sequence_id": "a" * 64,
    "template_id": "a" * 64,
    "track_id": "a" * 64,
    "name": "walls",
    "cases": ["a" * 64],
    "study": b"",
    "source": b"",
}
SUFFIXES = {"save_reconstruction": ".glb", "save_features": ".csv"}
NAMES = sorted(name for name in dir(Client) if name.startswith("save_"))


@pytest.fixture
def unreached() -> Iterator[Client]:
    # Nobody listens there: what asks for anything fails by another name.
    with Client("http://127.0.0.1:9", retries=Retries(attempts=1)) as client:
        yield client


@pytest.mark.parametrize("name", NAMES)
def test_a_place_that_cannot_be_written_costs_no_request(
    name: str, unreached: Client, tmp_path: Path
) -> None:
    save = getattr(unreached, name)
    wanted = {key: ARGUMENTS[key] for key in inspect.signature(save).parameters if key in ARGUMENTS}
    suffix = SUFFIXES.get(name, ".png")
    with pytest.raises(StoreError, match="there is no folder"):
        save(path=tmp_path / "missing" / f"a{suffix}", **wanted)
    (tmp_path / f"a{suffix}").mkdir()
    with pytest.raises(StoreError, match="it is a folder"):
        save(path=tmp_path / f"a{suffix}", **wanted)


def test_there_is_something_to_save() -> None:
    assert len(NAMES) >= 8
