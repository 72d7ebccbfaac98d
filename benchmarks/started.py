"""Programs started anew: their processor time beside that of importing NumPy."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Final

import numpy as np
from coded_sequences import beat
from real_data import ROOT

from modalmotion import write_npz

USUAL_SECONDS: Final = 0.07  # of importing NumPy, on a core of 2024


def processor_seconds(*commands: tuple[str, ...], n_rounds: int = 5) -> tuple[float, ...]:
    """Processor time of Python with each list of arguments, of a core that imports NumPy in 0.07 s.

    Modules are compiled in the first round, as those of installed packages are.
    """
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
        spent = [
            [_spent(command, environment) for command in (("-c", "import numpy"), *commands)]
            for _ in range(n_rounds + 1)
        ]
    unit, *times = np.array(spent[1:]).T
    return tuple(USUAL_SECONDS * float(np.median(of_command / unit)) for of_command in times)


def install_seconds() -> float:
    """Processor time from a wheel to the first signature, in an environment of its own.

    Measured where MEASURE_INSTALL is set: it asks for the network, whose time does not count.
    """
    if "MEASURE_INSTALL" not in os.environ:
        return recorded("use.install")
    with tempfile.TemporaryDirectory() as place:
        python = str(Path(place) / "venv" / "bin" / "python")
        pip = ("-m", "pip", "-q", "--disable-pip-version-check")
        _run(sys.executable, *pip, "wheel", "--no-deps", "-w", place, str(ROOT))
        _run(sys.executable, "-m", "venv", str(Path(place) / "venv"))
        before, (wheel,) = _children(), Path(place).glob("*.whl")
        _run(python, *pip, "install", str(wheel))
        _run(python, "-m", "modalmotion", "signature", saved(place), "-o", f"{place}/signature.h5")
        return _children() - before


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
    _run(sys.executable, *command, environment=environment)
    return _children() - before


def _run(*command: str, environment: dict[str, str] | None = None) -> None:
    # In a folder without the sources: what is installed, or stated, is run.
    subprocess.run(command, env=environment, capture_output=True, cwd="/", check=True)


def _children() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime
