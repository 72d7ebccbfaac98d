"""
How good is my tracking?
========================

Comparison of an estimated motion with the true one, by published measures.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import modalmotion as mm
from modalmotion.clinical.score import score

truth = mm.simulate_ventricle(acquisition=mm.Acquisition(n_frames=8))
x = truth.vertices.astype(float)

# %%
# Two estimates: one with nine tenths of the motion, one with an error of 1 mm at
# each vertex.
noise = np.random.default_rng(0).normal(size=x.shape)
estimates = {
    "a tenth missing": replace(truth, vertices=x[:1] + 0.9 * (x - x[:1])),
    "1 mm of noise": replace(truth, vertices=x + noise),
}
scores = {name: score(truth, estimate) for name, estimate in estimates.items()}
for name, one in scores.items():
    print(f"{name}: {one}")

# %%
labels = ("end_point_end_systole", "along_normal")
for k, (name, one) in enumerate(scores.items()):
    plt.bar(np.arange(2) + 0.4 * k, [getattr(one, label) for label in labels], 0.35, label=name)
plt.xticks([0.2, 1.2], ["end point, end systole", "along the normal"])
plt.ylabel("error, mm")
plt.legend()
