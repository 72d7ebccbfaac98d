"""The code in docs/client.md runs, in order, and gives what stands beside it."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest
from project import ROOT
from running import RunningService

from modalmotion.client import Client
from modalmotion.simulate import Acquisition, simulate_ventricle

DOCUMENT = ROOT / "docs" / "client.md"


def test_its_code_runs_and_says_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = DOCUMENT.read_text()
    blocks = re.findall(r"(?ms)^```python\n(.*?)^```", text)
    monkeypatch.chdir(tmp_path)
    service = RunningService(tmp_path / "results", {"WORKERS": "1"}).start()
    namespace: dict[str, object] = {}
    n_compared = 0
    # Whoever comes from the README has sent the same beat, and said nothing of it.
    beat = simulate_ventricle(acquisition=Acquisition(noise=0.6), rng=np.random.default_rng(1))
    with Client(service.base) as client:
        client.upload(beat)
    try:
        for block in blocks:
            lines = block.replace(":8000", f":{service.port}").splitlines()
            for statement in ast.parse("\n".join(lines)).body:
                code = ast.unparse(statement)
                if not isinstance(statement, ast.Expr):
                    exec(code, namespace)  # noqa: S102 (our own document)
                    continue
                value = eval(code, namespace)  # noqa: S307 (our own document)
                stated = lines[(statement.end_lineno or 1) - 1].partition("  # ")[2].strip()
                if stated and not stated.startswith("or "):
                    assert repr(value) == stated, code
                    n_compared += 1
    finally:
        for value in namespace.values():
            if isinstance(value, Client):
                value.close()
        service.stop()
    assert n_compared == 39
    assert (tmp_path / "beat.glb").is_file()
