"""
How do I send a moving surface to a colleague?
==============================================

One HTML file with the moving surface, without dependencies.
"""

import tempfile
from pathlib import Path

import modalmotion as mm

beat = mm.simulate_ventricle()
page = beat.save(Path(tempfile.mkdtemp()) / "beat.html")
print(f"{page.stat().st_size / 1e3:.0f} kB")

# %%
# Its modes can be changed, and its motion coloured. The same at one moment:
figure = mm.plot(beat)
