"""Sequences and shapes named on the command line."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.stated_facts import fact_options, stated_facts
from modalmotion.facts import NO_FACTS, Facts
from modalmotion.formats import Format, ReadOptions, read_sequence
from modalmotion.formats.raw import RAW_TYPES
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference


class GridShape(click.ParamType[tuple[int, ...]]):
    """A lattice shape such as 32,64."""

    name = "N,N'"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        """Read what was typed."""
        if isinstance(value, tuple):
            return value
        try:
            return tuple(int(n) for n in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is no lattice shape; write it as 32,64.", param, ctx)


class ReferenceShape(click.ParamType[Reference]):
    """A frame's number, or the mean shape."""

    name = "FRAME|mean"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> Reference:
        """Read what was typed."""
        if value == MEAN:
            return MEAN
        try:
            return int(str(value))
        except ValueError:
            self.fail(f"{value!r} is no frame; give its number, or {MEAN}.", param, ctx)


def sequence_argument(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add FILE and everything that may be said of it to a command.

    The command is called with `source`, the sequence's path, and `options`.
    """
    unit = click.option("--unit", help="Length unit: m, cm, mm, um or nm; over the file's own.")
    form = click.option(
        "--format",
        "form",
        type=click.Choice([f.value for f in Format]),
        help="Told from the content by default.",
    )
    interval = click.option(
        "--frame-interval", type=float, help="Seconds from frame to frame; over the file's own."
    )
    n_vertices = click.option("--n-vertices", type=int, help="Of raw numbers: vertices a frame.")
    dtype = click.option(
        "--dtype",
        type=click.Choice(list(RAW_TYPES)),
        default="float32",
        show_default=True,
        help="Of raw numbers, little-endian.",
    )
    source = click.argument(
        "source",
        metavar="FILE",
        nargs=-1,
        required=True,
        type=click.Path(path_type=Path),
        callback=_one_path,
    )
    for decorate in (fact_options, dtype, n_vertices, interval, form, unit, source):
        command = decorate(command)
    return command


def _one_path(_: click.Context, parameter: click.Parameter, paths: tuple[Path, ...]) -> Path:
    """Give the one path that was named; shells spread a pattern that stands without quotes."""
    if len(paths) > 1:
        raise click.BadParameter(
            f"{len(paths)} files are named, the first {paths[0].name!r}, the last "
            f"{paths[-1].name!r}. For frames of one sequence name their folder, or put the "
            "pattern in quotes: 'scan_*.ply'.",
            param=parameter,
        )
    return paths[0]


def read(
    source: Path,
    *,
    unit: str | None = None,
    form: str | None = None,
    frame_interval: float | None = None,
    n_vertices: int | None = None,
    dtype: str = "float32",
    grid: tuple[int, ...] | None = None,
    topology: str | None = None,
    facts: Facts = NO_FACTS,
    quiet: bool = False,
    **stated: Any,
) -> MeshSequence:
    """Read a sequence: a file, a folder of frames, or a pattern of their names.

    Frames that are files of their own show a bar; what was not used or guessed is said, unless
    this is one file of many (`quiet`). Options that state facts go over `facts`.
    """
    options = ReadOptions(
        format=None if form is None else Format(form),
        unit=unit,
        frame_interval=frame_interval,
        n_vertices=n_vertices,
        dtype=dtype,
        grid=grid,
        topology=topology,
        facts=stated_facts(stated).over(facts),
    )
    if quiet:
        return read_sequence(source, options).sequence
    with _FrameBar() as bar:
        result = read_sequence(source, options, progress=bar)
    if result.ignored:
        click.echo(f"not used: {', '.join(result.ignored)}", err=True)
    for note in result.notes:
        click.echo(f"note: {note}", err=True)
    return result.sequence


class _FrameBar:
    """A bar that appears when there are frames to count."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._open = contextlib.ExitStack()

    def __call__(self, done: int, total: int) -> None:
        if self._bar is None:
            bar = click.progressbar(length=total, label="frames", file=sys.stderr)
            self._bar = self._open.enter_context(bar)
        self._bar.update(done - self._bar.pos)

    def __enter__(self) -> _FrameBar:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()
