"""docs/readouts.md runs, and the report of the trade holds what it promises."""

from __future__ import annotations

import re
from pathlib import Path

from click.testing import CliRunner
from project import ROOT

from modalmotion.cli import main

DOCS = ROOT / "docs"


def test_its_code_and_its_command_run(tmp_path: Path) -> None:
    text = (DOCS / "readouts.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    namespace: dict[str, object] = {}
    for block in blocks:
        exec(block, namespace)  # noqa: S102 (our own document)
    assert len(blocks) == 2
    (command,) = re.findall(r"^```sh\nmodalmotion (.*?)\n```", text, re.MULTILINE | re.DOTALL)
    beat = tmp_path / "beat.npz"
    made = CliRunner().invoke(main, ["simulate", "-o", str(beat), "--frames", "5"])
    assert made.exit_code == 0, made.output
    arguments = [str(tmp_path / a) if "." in a else a for a in command.split()]
    run = CliRunner().invoke(main, arguments)
    assert run.exit_code == 0, run.output
    assert (tmp_path / "volume.png").read_bytes().startswith(b"\x89PNG")


def test_figures_are_there_and_small() -> None:
    for document in ("readouts.md", "tradeoff.md"):
        named = re.findall(r"!\[[^]]+\]\(([^)]+)\)", (DOCS / document).read_text())
        assert named, document
        for figure in named:
            assert (DOCS / figure).stat().st_size < 150_000, figure
