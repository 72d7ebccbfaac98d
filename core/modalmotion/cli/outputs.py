"""Files and folders that commands write: checked before any work, written whole or not at all."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import click

from modalmotion.errors import needs_extra
from modalmotion.exports.picture_files import PICTURES, write_picture

__all__ = [
    "MOVING",
    "PICTURES",
    "OutputFile",
    "OutputFolder",
    "require_matplotlib",
    "write_picture",
]

MOVING: Final = ".gif"
"""Suffix of a moving one."""


class OutputFile(click.Path):
    """A file to write: its suffix is known, its folder is there and can be written to.

    Parameters
    ----------
    *suffixes : str
        In small letters; any if there are none.
    """

    def __init__(self, *suffixes: str) -> None:
        super().__init__(path_type=Path)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check it, and that no other option names it."""
        path = Path(str(super().convert(value, param, ctx)))
        self.require(path, param, ctx)
        others = ctx.params.items() if ctx is not None else ()
        for name, other in others:
            if isinstance(other, Path) and other == path and _is_output(ctx, name):
                self.fail(f"{path.name} is named twice; name two files.", param, ctx)
        return path

    def require(self, path: Path, param: click.Parameter | None, ctx: click.Context | None) -> None:
        """Fail where the file cannot be written."""
        if self.suffixes and path.suffix.lower() not in self.suffixes:
            self.fail(f"{path.name} ends with none of {', '.join(self.suffixes)}.", param, ctx)
        if self.suffixes and path.suffix.lower() in (*PICTURES, MOVING):
            require_matplotlib()
        try:
            obstacle = _obstacle(path)
        except OSError as error:
            obstacle = f"'{path}' cannot be reached ({error.strerror}); name another file."
        if obstacle:
            self.fail(obstacle, param, ctx)


class OutputFolder(click.Path):
    """A folder to write to, which exists or can be made; or one of the files it would contain.

    Parameters
    ----------
    *suffixes : str
        Of such files, in small letters.
    """

    def __init__(self, *suffixes: str) -> None:
        super().__init__(path_type=Path)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check it, or the nearest folder above that is there."""
        if Path(str(value)).suffix.lower() in self.suffixes:
            return OutputFile().convert(value, param, ctx)
        if "://" in str(value):
            self.fail(f"'{value}' is no folder of this machine; name one that is.", param, ctx)
        path = Path(str(super().convert(value, param, ctx)))
        try:
            there = next(p for p in (path, *path.absolute().parents) if p.exists())
            obstacle = _obstacle_in(there)
        except OSError as error:
            obstacle = f"'{path}' cannot be reached ({error.strerror}); name another folder."
        if obstacle:
            self.fail(obstacle, param, ctx)
        return path


def require_matplotlib() -> None:
    """Refuse pictures where nothing draws them."""
    with needs_extra("plot"):
        if find_spec("matplotlib") is None:
            raise ModuleNotFoundError(name="matplotlib")


def _is_output(ctx: click.Context | None, name: str) -> bool:
    parameters = [] if ctx is None else ctx.command.params
    return any(p.name == name and isinstance(p.type, OutputFile) for p in parameters)


def _obstacle(path: Path) -> str:
    """Reason why a file cannot be written, with what to do; empty if it can."""
    if path.is_dir():
        return f"'{path}' is a folder; add the name of the file."
    if path.exists() and not path.is_file():
        return f"'{path}' is a device, not a file; name a file."
    if not path.parent.exists():
        return f"The folder '{path.parent}' does not exist; make it first."
    return _obstacle_in(path.parent)


def _obstacle_in(folder: Path) -> str:
    if not folder.is_dir():
        return f"'{folder}' is a file, not a folder; name a folder."
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"This user may not write in the folder '{folder}'; name another."
    return ""
