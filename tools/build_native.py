"""Compile the C sources of the codec into the package, for this machine.

From the project::

python tools/build_native.py
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "core"))

from modalmotion.native import PATH, SOURCES

FLAGS = (
    "-std=c11",
    "-O3",
    "-ffp-contract=off",
    "-ffreestanding",
    "-fvisibility=hidden",
    "-fPIC",
    "-shared",
    "-nostdlib",
    "-Wall",
    "-Wextra",
    "-Werror",
)


def build(target: Path = PATH, compiler: str = os.environ.get("CC", "cc")) -> Path:
    """Compile all sources to one library."""
    target.parent.mkdir(exist_ok=True)
    sources = [str(source) for source in sorted(SOURCES.glob("*.c"))]
    command = [compiler, *FLAGS, "-o", str(target), *sources]
    subprocess.run(command, check=True)  # noqa: S603 - of names that stand here
    return target


if __name__ == "__main__":
    print(build())
