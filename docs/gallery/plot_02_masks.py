"""
What is the ejection fraction of this segmentation?
===================================================

From any label map to volumes, ejection fraction and strain, with default options.
"""

import tempfile
from pathlib import Path

import nibabel
import numpy as np

import modalmotion as mm

# %%
# A short-axis stack of 12 phases with the usual labels: 3 the cavity, 2 its wall.
# Here two ellipsoids that are cut at the base replace
# the output of a segmenter.
axes = [1.5 * np.arange(72), 1.5 * np.arange(72), 8.0 * np.arange(14)]  # mm
x, y, z = np.meshgrid(*axes, indexing="ij")
phases = np.arange(12) / 12
maps = np.zeros((*x.shape, len(phases)), dtype=np.uint8)
for frame, phase in enumerate(phases):
    shorter = 1 - 0.13 * np.sin(np.pi * min(phase / 0.7, 1.0)) ** 2
    narrower = 1 - 0.28 * np.sin(np.pi * min(phase / 0.7, 1.0)) ** 2
    across = ((x - 54) ** 2 + (y - 54) ** 2) / (24 * narrower) ** 2
    along = ((z - 100) / (86 * shorter)) ** 2
    wall = ((x - 54) ** 2 + (y - 54) ** 2) / (24 * narrower + 9) ** 2
    outer = ((z - 100) / (86 * shorter + 9)) ** 2
    is_below_base = z <= 96
    maps[..., frame][(wall + outer < 1) & is_below_base] = 2
    maps[..., frame][(across + along < 1) & is_below_base] = 3

folder = Path(tempfile.mkdtemp())
image = nibabel.Nifti1Image(maps, np.diag([-1.5, -1.5, 8.0, 1.0]))
image.header.set_xyzt_units("mm", "sec")
image.header["pixdim"][4] = 0.08
image.to_filename(folder / "map.nii.gz")

# %%
# On the command line this is ``modalmotion report map.nii.gz -o out/``, which writes
# a PDF as well.
track = mm.track(folder / "map.nii.gz")
print(track)
fraction, bound = track.ejection_fraction, track.ejection_fraction_bound
print(f"ejection fraction {fraction:.1f} +- {bound:.1f} %")
print(track.strain())

# %%
# The surface over the labels, to check the result.
figure = mm.plot(track)
