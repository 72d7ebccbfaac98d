"""Which tests share a process of the test run."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

# Fixtures of a session that take seconds.
_SHARED = {
    "cluster": ("dask_cluster", "engine_client"),
    "trained": ("trained",),
}


class FileScheduling(LoadScopeScheduling):  # type: ignore[misc]
    """Tests of a file in one process, so that what it makes is made once.

    So are all files that use the tests' cluster, and all that use the trained service. The
    scheduler collects nothing and knows names alone: the fixtures are looked for in the text.
    """

    def __init__(self, config: pytest.Config, log: Producer | None = None) -> None:
        super().__init__(config, log)
        self.root = config.rootpath

    def _split_scope(self, nodeid: str) -> str:
        return _group(self.root / nodeid.split("::", 1)[0])


@cache
def _group(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    for group, fixtures in _SHARED.items():
        if re.search(rf"def \w+\([^)]*\b({'|'.join(fixtures)})\b", text):
            return group
    return str(path)
