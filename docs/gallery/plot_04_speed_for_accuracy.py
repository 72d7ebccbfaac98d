"""
What does each choice of modes cost?
====================================

Error, size and time of each number of modes on your own recording.
"""

import numpy as np

import modalmotion as mm

beat = mm.simulate_ventricle(n_vertices=1000, rng=np.random.default_rng(4))
trade = mm.measure_tradeoff(beat)
print(trade)

# %%
figure = mm.plot(trade)
