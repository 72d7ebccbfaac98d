"""Programs started anew: their processor time beside that of importing NumPy."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Final

from coded_sequences import beat

from modalmotion import write_npz

ROOT: Final = Path(__file__).resolve().parents[1]
USUAL_SECONDS: Final = 0.07
"""Of importing NumPy, on a core of 2024."""


def processor_seconds(*commands: tuple[str, ...], n_rounds: int = 5) -> tuple[float, ...]:
    """Processor time of Python's commands, of a core that imports NumPy in 0.07 s.

    Parameters
    ----------
    *commands : tuple of str
        Arguments of Python. Modules are compiled before, as those of installed packages are.
    """
    numpy = ("-c", "import numpy")
    ratios: list[list[float]] = [[] for _ in commands]
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
        for _ in range(n_rounds + 1):
            unit = _spent(numpy, environment)
            for of_command, command in zip(ratios, commands, strict=True):
                of_command.append(_spent(command, environment) / unit)
    return tuple(USUAL_SECONDS * statistics.median(of_command[1:]) for of_command in ratios)


def install_seconds(folder: Path, recording: str) -> float:
    """Time from a wheel to the first signature, in an environment of its own; asks for the network.

    Parameters
    ----------
    folder : Path
        Empty; the environment stays in it.
    recording : str
    """
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", str(folder), str(ROOT)]
    subprocess.run(build, check=True)
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
    wheel = str(next(folder.glob("*.whl")))
    programs = folder / "venv" / "bin"
    start = time.perf_counter()
    subprocess.run([programs / "python", "-m", "pip", "install", "-q", wheel], check=True)
    subprocess.run(
        [programs / "modalmotion", "signature", recording],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        check=True,
    )
    return time.perf_counter() - start


def saved(folder: str) -> str:
    """Write a beat as npz; give its path."""
    path = Path(folder) / "beat.npz"
    path.write_bytes(write_npz(beat(1500)))
    return str(path)


def recorded(name: str) -> float:
    """Read what was measured by hand, on the day that truth.toml states."""
    return float(tomllib.loads((ROOT / "benchmarks" / "truth.toml").read_text())[name]["value"])


def _spent(command: tuple[str, ...], environment: dict[str, str]) -> float:
    before = _children()
    python = [sys.executable, *command]
    subprocess.run(python, env=environment, stdout=subprocess.DEVNULL, check=True)
    return _children() - before


def _children() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime
