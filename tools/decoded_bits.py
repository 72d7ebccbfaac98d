"""Digests of what streams decode to, to compare machines: `make aarch64`.

::

    python tools/decoded_bits.py encode FOLDER
    python tools/decoded_bits.py decode FOLDER
"""

from __future__ import annotations

import hashlib
import platform
import sys
from pathlib import Path

from modalmotion.codec import Effort, decode, encode


def main() -> None:
    """Encode beats into a folder, or only decode what is there; print machine and digests."""
    folder = Path(sys.argv[2])
    if sys.argv[1] == "encode":
        write_streams(folder)
    print(platform.machine())
    for path in sorted(folder.glob("*.mmsq")):
        sequence = decode(path.read_bytes())
        held = sequence.vertices.tobytes() + sequence.faces.astype("<i8").tobytes()
        print(hashlib.sha256(held).hexdigest(), path.name)


def write_streams(folder: Path) -> None:
    """Encode a simulated ventricle, as a lattice and as a mesh, at every effort."""
    from modalmotion.mesh.sequence import mesh_sequence
    from modalmotion.simulate import Acquisition, simulate_ventricle

    folder.mkdir(parents=True, exist_ok=True)
    beat = simulate_ventricle(grid=(12, 24), acquisition=Acquisition(n_frames=9))
    for name, sequence in (("lattice", beat), ("mesh", mesh_sequence(beat.vertices, beat.faces))):
        for effort in Effort:
            stream = encode(sequence, rms=0.1, effort=effort)
            (folder / f"{name}-{effort.value}.mmsq").write_bytes(stream.data)


if __name__ == "__main__":
    main()
