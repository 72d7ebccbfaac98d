"""Vibration modes as files: npz and HDF5."""

from __future__ import annotations

import io

import numpy as np

from modalmotion.hdf5.image import INTENDED_USE, Dataset, json_text, sealed_image
from modalmotion.template.vibration_modes import VibrationModes


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
    kind = "vibration_modes"
    labels = [str(label) for label in modes.labels]
    return sealed_image(
        {
            "schema": f"modalmotion.{kind}",
            "schema_version": 1,
            "kind": kind,
            "intended_use": INTENDED_USE,
            "topology": modes.surface,
        },
        {},
        [
            Dataset("angular_frequencies", modes.angular_frequencies, modes.frequency_unit, "mode"),
            Dataset("shapes", modes.shapes, "1", "vertex, mode"),
            json_text("labels", {"labels": labels, "notes": modes.notes}),
        ],
    )
