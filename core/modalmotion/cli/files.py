"""Sequences named on the command line."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.options import (
    READING,
    options_of,
    several,
    signature_parameters,
)
from modalmotion.cli.stated_facts import fact_options, stated_facts
from modalmotion.cli.waiting import Waiting
from modalmotion.exports.reading import read_recording
from modalmotion.formats import ReadOptions
from modalmotion.formats.named_arrays import RAW_TYPES
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature, modal_signature


def _one_path(_: click.Context, parameter: click.Parameter, paths: tuple[Path, ...]) -> Path:
    """Return the one path; shells expand a pattern without quotes to many."""
    if len(paths) > 1:
        raise click.BadParameter(
            f"{len(paths)} files are named, the first {paths[0].name!r}, the last "
            f"{paths[-1].name!r}. For frames of one sequence name their folder, or put the "
            "pattern in quotes: 'scan_*.ply'.",
            param=parameter,
        )
    return paths[0]


sequence_argument = several(
    click.argument(
        "source",
        metavar="FILE",
        nargs=-1,
        required=True,
        type=click.Path(path_type=Path),
        callback=_one_path,
    ),
    options_of(
        ReadOptions,
        *("unit", "format", "frame_interval", "n_vertices", "dtype"),
        group=READING,
        dtype={"type": click.Choice(list(RAW_TYPES))},
    ),
    fact_options,
)
"""FILE, as `source`, and the options that describe it, named as in `ReadOptions`."""


def read(source: Path, **stated: Any) -> MeshSequence:
    """Read a sequence: a file, a folder of frames, or a pattern of their names.

    For a track its sequence is read, with the errors of the track. Frames that
    are files of their own show a progress bar; unused content and assumptions are printed.

    Parameters
    ----------
    source : Path
    **stated
        Fields of `ReadOptions`, and options that state facts.
    """
    options = ReadOptions(facts=stated_facts(stated), **stated)
    with _FrameBar() as bar:
        result = read_recording(source, options, progress=bar)
    if result.ignored:
        click.echo(f"not used: {', '.join(result.ignored)}", err=True)
    for note in result.notes:
        click.echo(f"note: {note}", err=True)
    return result.sequence


def fitted(
    source: Path, waiting: Waiting, options: dict[str, Any]
) -> tuple[MeshSequence, ModalSignature]:
    """Read a sequence and fit its signature with the options of a command."""
    parameters = signature_parameters(options)
    with waiting.watch.stage("read"):
        sequence = read(source, **options)
    return sequence, modal_signature(sequence, parameters, watch=waiting.watch)


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
