"""
Which kind of motion is this?
=============================

A class with its probability and the set that contains the true class in 90 % of cases; or no class,
and why.
"""

import numpy as np

import modalmotion as mm

weak_wall = mm.VentricleParameters(akinesia=1.0, ejection_fraction=0.42)
beat = mm.simulate_ventricle(weak_wall, rng=np.random.default_rng(5))
answer = beat.classify()
print(answer)

# %%
# The included model was trained on simulated ventricles only. Train your own on labelled
# recordings: see the guide on classes.
figure = mm.plot(answer)
