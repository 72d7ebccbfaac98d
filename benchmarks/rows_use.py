"""Rows of the table of truth: what it takes to use it."""

from __future__ import annotations

import tempfile

from experiments import Row, experiment, quick, timed
from real_data import ROOT
from started import install_seconds, processor_seconds, recorded, saved


@timed(
    Row("use.import", "import modalmotion, processor time", "s", tolerance=0.004),
    Row("use.help", "modalmotion --help, processor time", "s", tolerance=0.015),
    Row("use.signature", "modalmotion signature, cold, its time", "s", goal=0.5, tolerance=0.035),
)
def cold(_: int) -> tuple[float, ...]:
    with tempfile.TemporaryDirectory() as place:
        program = ("-m", "modalmotion")
        signature = (*program, "signature", saved(place), "-o", f"{place}/signature.h5")
        return processor_seconds(("-c", "import modalmotion"), (*program, "--help"), signature)


@quick(Row("use.readme", "lines of README", tolerance=5))
def readme(_: int) -> float:
    return len((ROOT / "README.md").read_text().splitlines())


@experiment(Row("use.install", "pip install to first signature, processor time", "s", tolerance=2))
def install(_: int) -> float:
    return install_seconds()


@experiment(Row("use.make_test", "make test, two cores", "s", goal=240, tolerance=20))
def make_test(_: int) -> float:
    return recorded("use.make_test")
