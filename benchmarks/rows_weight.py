"""Rows of the table of truth: what there is to read, and how much of it a call runs through."""

from __future__ import annotations

import ast
import io
import subprocess
import sys
import tokenize
from pathlib import Path
from typing import Final

from experiments import Row, experiment
from real_data import ROOT

PRODUCT: Final = (ROOT / "core", ROOT / "service")

_TRACED = """
import sys
from pathlib import Path
import numpy as np
import modalmotion as mm
beat = mm.simulate_ventricle(rng=np.random.default_rng(0))
{call}(beat)  # lazy imports are over
seen = set()
def trace(frame, event, argument):
    seen.add(frame.f_code.co_filename)
sys.setprofile(trace)
{call}(beat)
sys.setprofile(None)
print(sum("/modalmotion/" in name for name in seen))
"""


@experiment(
    Row("weight.core.code_lines", "code lines of the core", goal=33_000, tolerance=150),
    Row("weight.service.code_lines", "code lines of the service", goal=8_000, tolerance=150),
    Row("weight.core.files", "files of the core", goal=230, tolerance=3),
    Row("weight.service.files", "files of the service", goal=90, tolerance=3),
    Row("weight.import_lines", "import lines of core and service", goal=4_500, tolerance=60),
    quick=True,
)
def lines(_: int) -> tuple[float, ...]:
    counted = [[count(path) for path in folder.rglob("*.py")] for folder in PRODUCT]
    code = [sum(code for code, _ in of_folder) for of_folder in counted]
    imports = sum(n_imports for of_folder in counted for _, n_imports in of_folder)
    return (*code, *(len(of_folder) for of_folder in counted), imports)


@experiment(
    Row("weight.signature.files", "files that modal_signature runs through", goal=15, tolerance=0),
    Row("weight.classify.files", "files that classify runs through", goal=25, tolerance=0),
    Row("weight.upload.files", "files of a server from upload to class", goal=45, tolerance=1),
    quick=True,
)
def files_run_through(_: int) -> tuple[float, ...]:
    upload = [sys.executable, str(ROOT / "benchmarks" / "traced_upload.py")]
    of_calls = (_files_of(call) for call in ("mm.modal_signature", "mm.classify"))
    return (*of_calls, int(subprocess.check_output(upload, text=True).split()[-1]))


@experiment(
    Row("weight.options.track", "options of track", goal=9, tolerance=0),
    Row("weight.options.train", "options of train", goal=9, tolerance=0),
    Row("weight.options.signature", "fields of a signature's parameters", goal=14, tolerance=0),
    Row("weight.constants", "named constants of core and service", tolerance=20),
    quick=True,
)
def options(_: int) -> tuple[float, ...]:
    from dataclasses import fields

    from modalmotion import SignatureParameters
    from modalmotion.classification.options import TrainingOptions
    from modalmotion.tracking.parameters import TrackParameters

    classes = (TrackParameters, TrainingOptions, SignatureParameters)
    constants = sum(_constants(path) for folder in PRODUCT for path in folder.rglob("*.py"))
    return (*(len(fields(each)) for each in classes), constants)


def count(path: Path) -> tuple[int, int]:
    """Count code lines (no blank, comment, docstring or import lines) and import lines."""
    source = path.read_text()
    tree = ast.parse(source)
    aside: set[int] = set()
    imports: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        if isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str):
            aside.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    skipped = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
    code: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in (*skipped, tokenize.ENDMARKER):
            code.update(range(token.start[0], token.end[0] + 1))
    return len(code - aside - imports), len(imports)


def _files_of(call: str) -> int:
    code = _TRACED.format(call=call)
    return int(subprocess.check_output([sys.executable, "-c", code], text=True))


def _constants(path: Path) -> int:
    body = ast.parse(path.read_text()).body
    targets: list[ast.expr] = [node.target for node in body if isinstance(node, ast.AnnAssign)]
    targets += [t for node in body if isinstance(node, ast.Assign) for t in node.targets]
    return sum(isinstance(each, ast.Name) and each.id.strip("_").isupper() for each in targets)
