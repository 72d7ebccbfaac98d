"""
What do the modes look like?
============================

Vibration modes of a lattice of masses and springs, in closed form.
"""

import matplotlib.pyplot as plt
import numpy as np

import modalmotion as mm

# %%
# A cylinder of 40 by 100 masses. No eigenproblem is solved: frequencies and shapes are cosines of the wave numbers.
lattice = mm.Lattice(mm.CYLINDER, (40, 100))
modes = lattice.lowest_modes(7)
print([str(label) for label in modes.labels])
print(np.round(lattice.angular_frequencies(modes), 4))

# %%
shapes = lattice.shapes(modes).reshape(40, 100, -1)
_, axes = plt.subplots(1, 6, figsize=(12, 2.4))
for k, axis in enumerate(axes, start=1):
    axis.imshow(shapes[:, :, k], cmap="RdBu", aspect="auto")
    axis.set(title=str(modes.labels[k]), xticks=[], yticks=[])
