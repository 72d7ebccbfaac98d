"""Kernels of large meshes are mapped where they are, and not missed where they are not."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from mesh_kernels import compiled

from modalmotion.errors import ParameterError
from modalmotion.mesh import machine
from modalmotion.numeric.machine import image


def test_small_meshes_look_for_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "_mapped", [])
    assert machine.kernels_for(machine.LARGE - 1) is None
    assert machine.kernels_for(2**28) is None
    assert machine._mapped == []


def test_they_are_missed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(machine, "_mapped", [])
    monkeypatch.setattr(image, "is_served", lambda: True)
    monkeypatch.setenv(image.VARIABLE, str(tmp_path))
    with caplog.at_level(logging.WARNING):
        assert machine.kernels_for(machine.LARGE) is None
        assert machine.kernels_for(machine.LARGE) is None
    assert [record.message for record in caplog.records] == [machine._SLOWER]


def test_off_is_silent(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    monkeypatch.setattr(machine, "_mapped", [])
    monkeypatch.setenv(image.VARIABLE, image.OFF)
    assert machine.kernels_for(machine.LARGE) is None
    assert not caplog.records
    with pytest.raises(ParameterError, match="No folder"):
        machine.compile_kernels()


@compiled
def test_numbers_and_arrays_are_passed() -> None:
    kernels = machine.kernels_for(machine.LARGE)
    assert kernels is not None
    right = np.zeros(3, dtype=np.float32)
    assert kernels.run("scaled_to", 3, np.array([1.0, 2.0, 3.0]), 0.5, right) == 0
    assert right.tolist() == [0.5, 1.0, 1.5]


@pytest.mark.soak
@compiled
def test_compiling_gives_the_code_that_runs(tmp_path: Path) -> None:
    made = machine.compile_kernels(tmp_path)
    kept = next(p for f in image.folders() if (p := f / machine.file_name()).exists())
    assert made.read_bytes() == kept.read_bytes()
