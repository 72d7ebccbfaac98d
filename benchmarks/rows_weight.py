"""Rows of the table of truth: what there is to read, and how much of it a call runs through."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields
from itertools import chain

from counted import constants, count
from experiments import Row, quick
from real_data import ROOT

from modalmotion import SignatureParameters
from modalmotion.classification import TrainingOptions
from modalmotion.tracking.parameters import TrackParameters

PATHS = [
    sorted(path for path in (ROOT / part).rglob("*") if path.suffix in {".py", ".c", ".h"})
    for part in ("core", "service")
]


@quick(
    Row("weight.core.code_lines", "code lines of the core, C counted", goal=33_000, tolerance=150),
    Row("weight.service.code_lines", "code lines of the service", goal=8_000, tolerance=150),
    Row("weight.core.files", "files of the core", goal=230, tolerance=3),
    Row("weight.service.files", "files of the service", goal=90, tolerance=3),
    Row("weight.import_lines", "import lines of core and service", goal=4_500, tolerance=60),
)
def lines(_: int) -> tuple[float, ...]:
    core, service = ([sum(of) for of in zip(*map(count, paths), strict=True)] for paths in PATHS)
    return core[0], service[0], *map(len, PATHS), core[1] + service[1]


@quick(
    Row("weight.signature.files", "files that modal_signature runs through", goal=15, tolerance=0),
    Row("weight.classify.files", "files that classify runs through", goal=25, tolerance=0),
    Row("weight.upload.files", "files of a server from upload to class", goal=45, tolerance=1),
)
def files_run_through(_: int) -> tuple[float, ...]:
    traced = [sys.executable, str(ROOT / "benchmarks" / "traced.py")]
    calls = ("signature", "classify", "upload")
    return tuple(int(subprocess.check_output([*traced, each]).split()[-1]) for each in calls)


@quick(
    Row("weight.options.track", "options of track", goal=9, tolerance=0),
    Row("weight.options.train", "options of train", goal=9, tolerance=0),
    Row("weight.options.signature", "fields of a signature's parameters", goal=14, tolerance=0),
    Row("weight.constants", "named constants of core and service", tolerance=20),
)
def options(_: int) -> tuple[float, ...]:
    classes = (TrackParameters, TrainingOptions, SignatureParameters)
    named = sum(map(constants, chain(*PATHS)))
    return (*(len(fields(each)) for each in classes), named)
