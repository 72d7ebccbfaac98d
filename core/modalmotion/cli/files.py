"""Files and shapes named on the command line."""

from __future__ import annotations

from pathlib import Path

import click

from modalmotion.formats import read_npz
from modalmotion.sequence import MeshSequence


class SequenceFile(click.Path):
    """A file that holds a mesh sequence."""

    def __init__(self) -> None:
        super().__init__(exists=True, dir_okay=False, readable=True, path_type=Path)


class GridShape(click.ParamType[tuple[int, ...]]):
    """A lattice shape such as 32,64."""

    name = "N,N'"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        if isinstance(value, tuple):
            return value
        try:
            return tuple(int(n) for n in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is no lattice shape; write it as 32,64.", param, ctx)


def read_sequence(path: Path) -> MeshSequence:
    """Read a mesh sequence, saying which of its arrays were not used."""
    read = read_npz(path.read_bytes())
    if read.ignored:
        click.echo(f"not used: {', '.join(read.ignored)}", err=True)
    return read.sequence
