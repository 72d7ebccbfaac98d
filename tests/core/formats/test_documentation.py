"""The code in docs/formats.md that is ours runs; the code of other programs is their Python."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest
from project import ROOT

from modalmotion.formats import read_sequence, write_npz
from modalmotion.formats.frame_files import write_ply_zip
from modalmotion.simulate import simulate_ventricle

DOCUMENT = ROOT / "docs" / "formats.md"


def blocks(pattern: str) -> list[str]:
    return re.findall(rf"(?ms)^```{pattern}\n(.*?)^```", DOCUMENT.read_text(encoding="utf-8"))


def test_its_code_runs_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import io
    import zipfile

    sequence = simulate_ventricle()
    (tmp_path / "surface.npz").write_bytes(write_npz(sequence))
    with zipfile.ZipFile(io.BytesIO(write_ply_zip(sequence))) as archive:
        archive.extractall(tmp_path / "frames")
    (tmp_path / "frames" / "frames.ply.series").unlink(missing_ok=True)
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {}
    ours = blocks("python")
    assert len(ours) == 5
    for block in ours:
        exec(compile(block, DOCUMENT.name, "exec"), namespace)  # noqa: S102 - our own document
    for name in ("surface.vtkhdf", "surface.glb"):
        made = read_sequence(tmp_path / name).sequence
        assert made.n_frames == sequence.n_frames
        assert np.isfinite(made.vertices).all()


@pytest.mark.parametrize("code", blocks(r"python \w+"))
def test_code_for_other_programs_is_python(code: str) -> None:
    ast.parse(code)
