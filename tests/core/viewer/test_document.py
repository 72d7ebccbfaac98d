"""docs/viewer.md runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner
from project import ROOT

from modalmotion.cli import main

TEXT = (ROOT / "docs" / "viewer.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_its_code_runs() -> None:
    for extra in ("anywidget", "pandas", "xarray"):
        pytest.importorskip(extra)
    namespace: dict[str, object] = {}
    for block in blocks("python"):
        exec(block, namespace)  # noqa: S102 (our own document)
    assert "amplitude" in str(namespace["table"])


def test_its_commands_run(tmp_path: Path) -> None:
    simulate = ["simulate", "-o", str(tmp_path / "beat.npz"), "--frames", "5"]
    assert CliRunner().invoke(main, simulate).exit_code == 0
    (tmp_path / "cohort.csv").write_text("path\nbeat.npz\n")
    lines = [line for block in blocks("sh") for line in block.splitlines()]
    assert len(lines) == 5
    for line in lines:
        arguments = [str(tmp_path / a) if "." in a else a for a in line.split()[1:]]
        run = CliRunner().invoke(main, arguments)
        assert run.exit_code == 0, run.output


def test_its_figure_is_there_and_small() -> None:
    (figure,) = re.findall(r"!\[[^]]+\]\(([^)]+)\)", TEXT)
    assert (ROOT / "docs" / figure).stat().st_size < 200_000
