"""Programs started anew: their processor time beside that of importing what they are made of."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from coded_sequences import beat
from real_data import ROOT

from modalmotion import write_npz

USUAL: Final = ("-c", "import numpy, scipy.sparse.linalg, scipy.spatial, h5py, click, asyncio")
USUAL_SECONDS: Final = 0.4  # of that, on a core of 2024
Start = Callable[[dict[str, str]], float]


def processor_seconds(*commands: tuple[str, ...]) -> tuple[float, ...]:
    """Processor time of Python with each list of arguments, of a core with the usual imports."""
    return beside_imports(*(partial(_spent, command) for command in commands))


def beside_imports(*starts: Start, n_rounds: int = 5) -> tuple[float, ...]:
    """Processor seconds of what is started in an environment, of a core with the usual imports.

    In turn with these, so both meet the same machine. Modules are compiled in the first round, as
    those of installed packages are.
    """
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"PYTHONPYCACHEPREFIX": cache, "PYTHONDONTWRITEBYTECODE": ""}
        in_turn: list[Start] = [partial(_spent, USUAL), *starts]
        spent = [[start(environment) for start in in_turn] for _ in range(n_rounds + 1)]
    unit, *times = np.array(spent[1:]).T
    return tuple(USUAL_SECONDS * float(np.median(of_start / unit)) for of_start in times)


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
