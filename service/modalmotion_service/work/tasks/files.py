"""What all tasks do with files: read an upload, a template; write a whole file."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Final

from modalmotion.fit.cache import TemplateCache
from modalmotion.formats import ParserHere, ReadOptions, ReadResult, read_sequence
from modalmotion.store import template_from_hdf5
from modalmotion.template import Template

# Templates and factored modes that a worker holds on to, each.
_KEPT_BYTES: Final = 32_000_000


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path to write to; what was written is at `path` as a whole or not at all.

    A worker that is thought lost may still be at the same work as the one in its place. One that
    dies leaves a file whose name begins as that of `path`, which the server removes.
    """
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(8)}")
    yield temporary
    temporary.replace(path)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file as `whole_file` has it."""
    with whole_file(path) as temporary:
        temporary.write_bytes(data)


def read_upload(upload: Path, options: ReadOptions) -> ReadResult:
    """Read an upload as its options say.

    Raises
    ------
    InputError
        If it is not understood, or beyond a limit.
    """
    # This process may be lost and is limited from outside: parsers need none of their own.
    return read_sequence(upload.read_bytes(), options, parser=ParserHere(options.limits))


def named_template(template: Path | None) -> Template | None:
    """Load the template that parameters name, once for all tasks of this process."""
    if template is None:
        return None
    # The path ends with the template's id, which stands for its content.
    return _kept().named(template.name, lambda: template_from_hdf5(template))


def cache_for(template: Template | None) -> TemplateCache | None:
    """Give the cache for factored modes, of named templates alone."""
    # A sequence's own template is seldom asked for again.
    return None if template is None else _kept()


@lru_cache(maxsize=1)
def _kept() -> TemplateCache:
    """Give what this process has made ready for cohorts that name a template."""
    return TemplateCache(most_bytes=_KEPT_BYTES)
