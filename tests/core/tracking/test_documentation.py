"""The page on tracking: its code runs, in order, and its figures of shapes are right."""

from __future__ import annotations

import re

from project import ROOT


def test_the_code_of_the_page_runs() -> None:
    text = (ROOT / "docs" / "tracking.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    assert len(blocks) == 7
    namespace: dict[str, object] = {}
    for block in blocks:
        exec(block, namespace)  # noqa: S102 (our own page)
    result = namespace["result"]
    assert result.sequence.n_frames == 6  # type: ignore[attr-defined]
    assert result.deviations.shape == (6, 2048, 2)  # type: ignore[attr-defined]
    assert namespace["again"].sequence.id == result.sequence.id  # type: ignore[attr-defined]
