"""Norms as files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from norm_controls import beat, drawn, norm_of

from modalmotion.errors import CorruptFileError, NotFoundError
from modalmotion.norm import norm_from_hdf5, norm_to_hdf5, train_norm


def test_a_norm_comes_back_with_the_same_answers() -> None:
    norm = train_norm([beat(seed) for seed in range(19)], "volunteers")
    data = norm_to_hdf5(norm)
    again = norm_from_hdf5(data)
    assert (again.id, again.name, again.n_controls) == (norm.id, "volunteers", 19)
    own = beat(100)
    assert again.deviation(own) == norm.deviation(own)
    assert norm_to_hdf5(again) == data


def test_damage_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    data = bytearray(norm_to_hdf5(norm_of([drawn(rng, k) for k in range(20)])))
    data[len(data) // 2] ^= 1
    path = tmp_path / "norm.h5"
    path.write_bytes(data)
    with pytest.raises(CorruptFileError):
        norm_from_hdf5(path)
    with pytest.raises(NotFoundError):
        norm_from_hdf5(tmp_path / "none.h5")


def test_no_name_of_a_file_is_kept(rng: np.random.Generator) -> None:
    readings = [drawn(rng, k) for k in range(20)]
    plain = norm_to_hdf5(norm_of(readings))
    assert b"secret.npz" not in plain
    assert norm_from_hdf5(plain).controls[0].name == ""
