"""Vibration modes as files: npz and HDF5."""

from __future__ import annotations

import io
from typing import Final

import numpy as np

from modalmotion.hdf5.form import Form
from modalmotion.hdf5.image import Dataset, json_text
from modalmotion.template.vibration_modes import VibrationModes

FORM: Final = Form("vibration_modes", 1)


def modes_to_npz(modes: VibrationModes) -> bytes:
    """Write `modes` (labels), `angular_frequencies` and `shapes` as .npz."""
    buffer = io.BytesIO()
    np.savez(
        buffer,
        modes=np.array([str(label) for label in modes.labels]),
        angular_frequencies=modes.angular_frequencies,
        shapes=modes.shapes,
    )
    return buffer.getvalue()


def modes_to_hdf5(modes: VibrationModes) -> bytes:
    """Write labels, angular frequencies and shapes as a sealed HDF5 file."""
    labels = [str(label) for label in modes.labels]
    datasets = [
        Dataset("angular_frequencies", modes.angular_frequencies, modes.frequency_unit, "mode"),
        Dataset("shapes", modes.shapes, "1", "vertex, mode"),
        json_text("labels", {"labels": labels, "notes": modes.notes}),
    ]
    return FORM.image({}, datasets, topology=modes.surface)
