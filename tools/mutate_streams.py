"""Decode damaged streams under AddressSanitizer, and count what goes wrong.

Mutants have right checksums, so that the decoders go on; each is decoded by the package and by
`mm_decode`. A read or write outside of an array, or what C leaves undefined, ends the run::

    python tools/mutate_streams.py 20000
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
import tempfile
import zlib
from collections import Counter
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
CHECKED: Final = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g")
PLACES: Final = [ROOT / "core", ROOT / "tests" / "support"]


def compile_checked(folder: Path) -> tuple[Path, str]:
    """Compile the library with checks; gives it, and what a process must load first."""
    library = folder / "checked.so"
    sources = sorted((ROOT / "core" / "modalmotion").glob("*/native/[!f]*.c"))
    flags = ["-std=c11", "-O1", "-ffp-contract=off", "-shared", "-fPIC", *CHECKED]
    subprocess.run(["cc", *flags, "-o", str(library), *map(str, sources)], check=True)  # noqa: S607
    named = [["cc", f"-print-file-name={name}"] for name in ("libasan.so", "libubsan.so")]
    found = [subprocess.check_output(command, text=True).strip() for command in named]
    return library, " ".join(found)


def mutant_of(data: bytes, rng: random.Random) -> bytes:
    """Change some bytes of one section, or its length, and make the checksums right."""
    from modalmotion.codec.coder import read_varint, write_varint

    at, sections = 5, []
    while at < len(data):
        length, start = read_varint(data, at)
        sections.append(bytearray(data[start : start + length]))
        at = start + length + 4
    chosen = rng.choice([section for section in sections if section])
    for _ in range(rng.choice((1, 1, 1, 2, 5, 40))):
        place = rng.randrange(min(len(chosen), rng.choice((12, 60, len(chosen)))))
        change = rng.randrange(4)
        if change == 0 and len(chosen) > 1:
            del chosen[place]
        elif change == 1:
            chosen.insert(place, rng.choice((0, 127, 128, 255)))
        elif change == 2:
            chosen[place] = rng.choice((0, 1, 127, 128, 255))
        else:
            chosen[place] ^= 1 << rng.randrange(8)
    parts = [data[:5]]
    for section in sections:
        parts += [write_varint(len(section)), bytes(section)]
        parts.append(zlib.crc32(section).to_bytes(4, "little"))
    return b"".join(parts)


def decode_mutants(count: int, library: Path) -> None:
    """Decode mutants with a library, and tell what became of them."""
    import numpy as np
    from codec_sequences import jointed, lattice_sequence, small_mesh_of_tube

    from modalmotion.codec import decode, encode
    from modalmotion.errors import ModalMotionError
    from modalmotion.limits import ReadLimits
    from modalmotion.numeric import native

    native.library.cache_clear()
    native.PATH, native._COMPILER = library, library.parent / "none"  # type: ignore[misc]
    from whole_decoder import whole

    rng, chance = random.Random(1994), np.random.default_rng(7)  # noqa: S311 - of damage
    targets: tuple[dict[str, Any], ...] = (
        {"rms": 0.3},
        {"max_error": 0.05},
    )
    kept = [
        encode(make(chance), effort=effort, **target).data
        for make in (small_mesh_of_tube, jointed, lattice_sequence)
        for effort in ("fast", "balanced")
        for target in targets
    ]
    limits = ReadLimits(frames=1000, vertices=20_000, faces=40_000, decompressed_bytes=10**8)
    outcomes: Counter[str] = Counter()
    for number in range(count):
        data = mutant_of(rng.choice(kept), rng)
        Path(library.parent, "last").write_bytes(data)
        try:
            found = decode(data, limits=limits)
            outcomes[f"decoded, {'finite' if np.isfinite(found.vertices).all() else 'not'}"] += 1
        except ModalMotionError as error:
            outcomes[type(error).__name__] += 1
            if error.limit:
                continue
        state = whole(data)
        outcomes[f"mm_decode: {state if isinstance(state, int) else 'decoded'}"] += 1
        if number % 2000 == 1999:
            print(number + 1, dict(outcomes), flush=True)
    print(count, "mutants, 0 faults:", dict(outcomes))


def main(count: int) -> int:
    """Run in a process that has the checks loaded; gives its exit status."""
    with tempfile.TemporaryDirectory() as folder:
        library, preload = compile_checked(Path(folder))
        environment = {
            **os.environ,
            "LD_PRELOAD": preload,
            "ASAN_OPTIONS": "detect_leaks=0",
            "PYTHONPATH": os.pathsep.join(map(str, PLACES)),
            "OPENBLAS_NUM_THREADS": "1",
        }
        command = [sys.executable, __file__, str(count), str(library)]
        done = subprocess.run(command, env=environment, check=False)
        last = Path(folder, "last")
        if done.returncode and last.exists():
            Path("mutant.bin").write_bytes(last.read_bytes())
            print("The stream at fault: mutant.bin", file=sys.stderr)
    return done.returncode


if __name__ == "__main__":
    if len(sys.argv) > 2:
        decode_mutants(int(sys.argv[1]), Path(sys.argv[2]))
    else:
        sys.exit(main(int(sys.argv[1])))
