"""
How much does this wall shorten?
================================

Longitudinal, circumferential and area strain of a moving mesh, each with a 95 % interval.
"""

import numpy as np

import modalmotion as mm

# %%
# A heartbeat of a left ventricle as 25 triangle meshes. Your own: ``beat =
# mm.read("folder/")``.
# Positions of a scanner are noisy, so 0.6 mm of noise is added to each vertex.
beat = mm.simulate_ventricle(rng=np.random.default_rng(1))
noise = np.random.default_rng(2).normal(scale=0.6, size=beat.vertices.shape)
measured = mm.mesh_sequence(beat.vertices + noise, beat.faces, times=beat.times, unit="mm")

# %%
# Strain is computed from lengths of lines on a smooth surface, so noise neither
# increases nor hides it.
strain = measured.strain()
print(strain)
print("without noise:", beat.strain())

# %%
# Curves over the beat, with end diastole and end systole marked.
figure = mm.plot(strain)
