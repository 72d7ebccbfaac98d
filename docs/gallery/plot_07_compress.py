"""
How small can this recording be?
================================

A stream with a chosen error that is never exceeded.
"""

import matplotlib.pyplot as plt
import numpy as np

import modalmotion as mm

beat = mm.simulate_ventricle()
sizes = []
errors = (2.0, 1.0, 0.5, 0.2, 0.1, 0.05)
for error in errors:
    stream = beat.encode(max_error=error)
    again = mm.decode(stream)
    assert np.linalg.norm(again.vertices - beat.vertices, axis=2).max() <= error
    sizes.append(len(stream.data) / 1e3)

# %%
# As float32 the positions alone have 614 kB.
plt.plot(errors, sizes, marker="o")
plt.xscale("log")
plt.xlabel("largest error of any vertex, mm")
plt.ylabel("stream, kB")
plt.ylim(0)
