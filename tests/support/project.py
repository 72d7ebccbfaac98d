"""Where the project lies, and the real sequences beside it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]

DATA: Final = Path(os.environ.get("MODALMOTION_DATA") or ROOT.parent / "shared" / "data")
"""Real recordings. Absent on most machines: tests and benches that read them skip then."""
