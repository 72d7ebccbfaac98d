"""
How do I send a moving surface to a colleague?
==============================================

One HTML file that moves, and needs nothing else.
"""

import tempfile
from pathlib import Path

import modalmotion as mm

beat = mm.simulate_ventricle()
page = beat.save(Path(tempfile.mkdtemp()) / "beat.html")
print(f"{page.stat().st_size / 1e3:.0f} kB")

# %%
# Its modes can be pushed, and its motion coloured. The same at one moment:
figure = mm.plot(beat)
