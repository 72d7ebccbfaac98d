"""Vibration modes as files: what is written is read back."""

from __future__ import annotations

import io

import h5py
import numpy as np

from modalmotion.exports.animation import FORM, modes_to_hdf5, modes_to_npz
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import Topology
from modalmotion.template.vibration_modes import lattice_modes


def test_both_files_hold_labels_frequencies_and_shapes() -> None:
    modes = lattice_modes(Lattice(Topology.parse("open x open x closed"), (3, 4, 5)), 6)
    with np.load(io.BytesIO(modes_to_npz(modes))) as arrays:
        assert arrays["modes"].tolist() == [str(label) for label in modes.labels]
        assert np.array_equal(arrays["shapes"], modes.shapes)
        assert np.array_equal(arrays["angular_frequencies"], modes.angular_frequencies)
    data = modes_to_hdf5(modes)
    assert data == modes_to_hdf5(modes)
    with FORM.read(data) as contents:
        assert np.array_equal(contents.array("shapes", (60, len(modes))), modes.shapes)
        assert contents.json("labels", dict)["labels"] == [str(label) for label in modes.labels]
    with h5py.File(io.BytesIO(data)) as file:
        assert file["angular_frequencies"].attrs["unit"] == b"rad per time unit for K = M = 1"
