"""
How do I follow a surface through clouds of points?
===================================================

Unordered points, different in each frame, become one moving surface.
"""

import numpy as np

import modalmotion as mm

# %%
# 1,500 points per frame from a moving wall, each off by 0.5 mm.
beat = mm.simulate_ventricle(acquisition=mm.Acquisition(n_frames=10))
rng = np.random.default_rng(3)
clouds = [
    frame[rng.choice(len(frame), 1500, replace=False)] + rng.normal(scale=0.5, size=(1500, 3))
    for frame in beat.vertices.astype(float)
]

# %%
# A surface of the first frame gives the kind of object.
start = mm.mesh_sequence(beat.vertices[:1], beat.faces, topology="cup", unit="mm")
track = mm.track(clouds, start=start, unit="mm")
print(track)

# %%
# Each vertex has a stated deviation, and so has every figure that is computed from
# the surface.
print(f"ejection fraction {track.ejection_fraction:.1f} +- {track.ejection_fraction_bound:.1f} %")
figure = mm.plot(track)
