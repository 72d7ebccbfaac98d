"""The page on tracking: its code runs, in order, and its figures of shapes are right."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from figures import tracking
from project import ROOT


def test_the_code_of_the_page_runs() -> None:
    text = (ROOT / "docs" / "tracking.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    assert len(blocks) == 6
    namespace: dict[str, object] = {}
    for block in blocks:
        exec(block, namespace)  # noqa: S102 (our own page)
    result = namespace["result"]
    assert result.sequence.n_frames == 6  # type: ignore[attr-defined]
    assert result.deviations.shape == (6, 2048, 2)  # type: ignore[attr-defined]
    assert namespace["again"].sequence.id == result.sequence.id  # type: ignore[attr-defined]


@pytest.mark.thorough
def test_its_figures_are_drawn_and_kept() -> None:
    text = (ROOT / "docs" / "tracking.md").read_text()
    for name, figure in tracking(n_frames=1, coarseness=2.5).items():
        buffer = io.BytesIO()
        figure.savefig(buffer, format="rgba", dpi=30)
        pixels = np.frombuffer(buffer.getvalue(), dtype=np.uint8)
        assert 0.02 < (pixels < 250).mean() < 0.9
        assert f"(figures/{name})" in text
        kept = ROOT / "docs" / "figures" / name
        assert kept.read_bytes().startswith(b"\x89PNG")
        assert kept.stat().st_size < 150_000
