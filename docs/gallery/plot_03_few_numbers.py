"""
How few numbers describe this motion?
=====================================

A modal signature: a few amplitudes per frame, and their residual error.
"""

import modalmotion as mm

beat = mm.simulate_ventricle()

# %%
# Seven modes are 21 amplitudes per frame, for 2,048 vertices.
signature = beat.signature(modes=7)
print(signature)
print(f"one number for {signature.compression:.0f} coordinates")

# %%
# Or give an error: the fewest modes that meet it are found.
print(beat.signature(tolerance=0.3))

# %%
figure = mm.plot(signature)
