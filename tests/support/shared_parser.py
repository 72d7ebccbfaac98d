"""One parser's process for the files of many tests, which else start some hundred of them."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from modalmotion.formats.parser_process import ParserProcess
from modalmotion.formats.result import Answer

_USUAL_SECONDS = 60.0


@contextmanager
def shared_parsers() -> Iterator[None]:
    """Hand the child of a `ParserProcess` that is left in peace to the next one that needs one."""
    spare: list[subprocess.Popen[bytes]] = []
    parse, end = ParserProcess.parse, ParserProcess.__exit__

    def shared_parse(own: ParserProcess, task: str, data: bytes) -> Answer:
        while own._seconds == _USUAL_SECONDS and own._child is None and spare:
            # It ends with the thread that began it.
            if (child := spare.pop()).poll() is None:
                own._child = child
            else:
                child.communicate()
        return parse(own, task, data)

    def leave(own: ParserProcess, *error: object) -> None:
        if own._seconds == _USUAL_SECONDS and own._child is not None:
            spare.append(own._child)
            own._child = None
        end(own, *error)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ParserProcess, "parse", shared_parse)
        patch.setattr(ParserProcess, "__exit__", leave)
        yield
    for child in spare:
        child.kill()
        child.communicate()
