"""What cannot be saved is refused before anything is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from modalmotion.client import Client, Retries
from modalmotion.errors import ParameterError, StoreError


@pytest.fixture
def unreached() -> Iterator[Client]:
    # Nobody listens there: what asks for anything fails by another name.
    with Client("http://127.0.0.1:9", retries=Retries(attempts=1)) as client:
        yield client


def test_a_missing_folder_costs_no_request(unreached: Client, tmp_path: Path) -> None:
    path = tmp_path / "missing" / "a.zip"
    with pytest.raises(StoreError, match="there is no folder"):
        unreached.save_dicom("a" * 64, b"", path)
    with pytest.raises(StoreError, match="there is no folder"):
        unreached.save_tracked_report(b"", path)


def test_what_is_not_there_names_what_is(unreached: Client, tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="signature"):
        unreached.save("lunch", tmp_path / "a.png")
    with pytest.raises(ParameterError, match=r"\.h5"):
        unreached.save("norm", tmp_path / "a.png", "mine")
