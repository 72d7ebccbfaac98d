"""
Does it work for other organs than hearts?
===========================================

A tongue in speech as an open curve; the same calls as for a heart.
"""

import matplotlib.pyplot as plt
import numpy as np

import modalmotion as mm

# %%
# A contour of 40 points that rises in the middle and then at the tip, 60 frames at
# 100 Hz.
s, t = np.linspace(0, 1, 40), np.arange(60) / 100
middle = np.exp(-(((s - 0.5) / 0.2) ** 2))[None] * np.sin(np.pi * t / 0.6)[:, None] ** 2
lifted = np.clip(np.sin(2 * np.pi * (t - 0.3) / 0.6), 0, 1)[:, None]
tip = np.exp(-(((s - 0.95) / 0.15) ** 2))[None] * lifted
points = np.stack(
    [np.broadcast_to(60 * s, middle.shape), 8 * middle + 6 * tip, np.zeros_like(middle)], axis=2
)
tongue = mm.mesh_sequence(points, topology="open curve", grid=(40,), times=t, unit="mm")

# %%
signature = tongue.signature(modes=6)
print(signature)

# %%
for mode in range(1, 4):
    plt.plot(t, signature.amplitudes[:, mode, 1], label=f"mode {signature.modes.labels[mode]}")
plt.xlabel("time, s")
plt.ylabel("amplitude across, mm")
plt.legend()
