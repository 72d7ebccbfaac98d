"""The demonstration, as `make demo` runs it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from demo import main

from modalmotion.formats import write_npz
from modalmotion.simulate import Acquisition, simulate_ventricle


def test_a_file_goes_through_a_service_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # It starts the program itself, which takes seconds: the first thing that a reader types.
    monkeypatch.setenv("MODALMOTION_WORKERS", "1")
    sequence = simulate_ventricle(
        grid=(8, 16), acquisition=Acquisition(n_frames=6), rng=np.random.default_rng(1)
    )
    (tmp_path / "beat.npz").write_bytes(write_npz(sequence))
    arguments = [str(tmp_path / "beat.npz"), "--output", str(tmp_path / "out")]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    assert "6 frames of 128 vertices" in result.output
    assert f"/view/{sequence.id}" in result.output
    assert sequence.id[:12] in result.output
    assert "the same amplitudes over HTTP: yes" in result.output
    assert list((tmp_path / "out").glob("*.png"))
