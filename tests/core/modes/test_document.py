"""docs/lattice.md runs, says what it says, and its figures are drawn from the library."""

from __future__ import annotations

import ast
import io
import re

import numpy as np
import pytest
from click.testing import CliRunner
from figures import FIGURES
from project import ROOT

import modalmotion.modes
from modalmotion.cli import main

TEXT = (ROOT / "docs" / "lattice.md").read_text()
BLOCKS = re.findall(r"^```python\n(.*?)^```", TEXT, flags=re.MULTILINE | re.DOTALL)
STATED = re.compile(r"True|array\(.*\)|\(.*\)|\[.*\]|'.*'|[0-9.]+")


def test_its_code_runs_and_gives_what_stands_beside_it() -> None:
    namespace: dict[str, object] = {}
    n_compared = 0
    for block in BLOCKS:
        lines = block.splitlines()
        for statement in ast.parse(block).body:
            code = ast.unparse(statement)
            if not isinstance(statement, ast.Expr):
                exec(code, namespace)  # noqa: S102 (our own document)
                continue
            value = eval(code, namespace)  # noqa: S307 (our own document)
            comment = lines[(statement.end_lineno or 1) - 1].partition("  # ")[2].strip()
            if stated := STATED.match(comment):
                assert repr(value) == stated[0], code
                n_compared += 1
    assert n_compared == 21


def test_every_public_name_of_lattices_and_dynamics_is_on_the_page() -> None:
    named = set(re.findall(r"\w+", TEXT))
    # A value that a function of the page gives.
    given = {"ExactStep"}
    # What signatures and templates use, and no reader of the page.
    inner = {"ModeSet", "wave_pairs", "whole_count", "whole_counts"}
    assert set(modalmotion.modes.__all__) - named - given - inner == set()


def test_its_commands_run(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(str(tmp_path))
    (block,) = re.findall(r"^```sh\n(.*?)^```", TEXT, flags=re.MULTILINE | re.DOTALL)
    for line in block.splitlines():
        program, *arguments = line.split()
        assert program == "modalmotion"
        done = CliRunner().invoke(main, arguments)
        assert done.exit_code == 0, done.output


@pytest.mark.parametrize("name", FIGURES)
def test_its_figures_are_drawn_and_kept(name: str) -> None:
    buffer = io.BytesIO()
    FIGURES[name]().savefig(buffer, format="rgba", dpi=30)
    pixels = np.frombuffer(buffer.getvalue(), dtype=np.uint8)
    assert 0.02 < (pixels < 250).mean() < 0.9
    assert f"(figures/{name})" in TEXT
    kept = ROOT / "docs" / "figures" / name
    assert kept.read_bytes().startswith(b"\x89PNG")
    assert kept.stat().st_size < 150_000
