"""Fixtures that every test may ask for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from modalmotion.formats import read_npz
from modalmotion.mesh.sequence import MeshSequence

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20_260_101)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real sequences beside the project; tests that need it skip without it."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the folder of real sequences (../shared/data) is absent")
    return folder


@pytest.fixture(scope="session")
def real_sequence(real_data: Path) -> Callable[[str], MeshSequence]:
    """Read a real sequence by its name, such as "heart/lv_endocardium"."""
    return lambda name: read_npz((real_data / f"{name}.npz").read_bytes()).sequence
