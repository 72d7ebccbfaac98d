"""Damaged streams under AddressSanitizer."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from project import ROOT


@pytest.mark.soak
@pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("cc") is None, reason="needs cc and its sanitizers"
)
def test_twenty_thousand_mutants_read_and_write_within_their_arrays(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / "tools" / "mutate_streams.py"), "20000"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    assert "20000 mutants, 0 faults" in done.stdout
