"""
Where is the surface between two frames?
========================================

The surface at any phase of its cycle, with the error of the interpolation.
"""

import numpy as np

import modalmotion as mm

beat = mm.simulate_ventricle(acquisition=mm.Acquisition(n_frames=30))
every_second = mm.mesh_sequence(beat.vertices[::2], beat.faces, topology="cup", unit="mm")

# %%
# The frames that were left out, from those that were kept.
between = (np.arange(15) + 0.5) / 15
found = mm.resample(every_second, list(between))
error = np.sqrt(((found.sequence.vertices - beat.vertices[1::2]) ** 2).mean())
print(f"RMS error {error:.3f} mm, stated {np.sqrt((found.deviations**2).mean()):.3f} mm")

# %%
# Sixty frames for a smooth film.
figure = mm.plot(mm.resample(beat, list(np.arange(60) / 60)).sequence)
