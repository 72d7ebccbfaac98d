"""Files that commands read: arguments and options for them, facts, and progress while waiting."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

import click

from modalmotion import errors, formats
from modalmotion.cli.shared import (
    FACTS,
    READING,
    Grouped,
    options_of,
    several,
    signature_parameters,
)
from modalmotion.exports.reading import read_recording
from modalmotion.formats import named_arrays
from modalmotion.mesh import NO_FACTS, WORDS, Facts, facts_from_texts
from modalmotion.mesh.facts import stated_twice
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress, Reporter, Stopwatch
from modalmotion.signature.making import ModalSignature, modal_signature

if TYPE_CHECKING:
    from modalmotion.classification import TrainingCase, cases

T = TypeVar("T")

_MANY: Final = {
    "landmark": (
        "NAME=PLACE",
        "A vertex's number or a point x,y,z, such as apex=17; repeat for more.",
    ),
    "covariate": ("NAME=VALUE", "A number or a word, such as age=61; repeat for more."),
}
_UNSTATED: Final = {"default": None}

FACT_OPTIONS: Final = (*WORDS, "period", "modality", *_MANY)
"""Names of these options."""

fact_options = several(
    options_of(Facts, *WORDS, "period", "modality", group=FACTS, **dict.fromkeys(WORDS, _UNSTATED)),
    *(
        click.option(
            f"--{name}", cls=Grouped, group=FACTS, metavar=metavar, multiple=True, help=text
        )
        for name, (metavar, text) in _MANY.items()
    ),
)
"""Facts, which override the file's own; `stated_facts` reads them."""


def stated_facts(options: dict[str, Any]) -> Facts:
    """Take the options that state facts out of all options.

    Raises
    ------
    ParameterError
        If one is out of range, or something is stated twice.
    """
    texts: dict[str, Any] = {name: options.pop(name, None) for name in FACT_OPTIONS}
    for kind in _MANY:
        for pair in texts.pop(kind) or ():
            name, equals, value = pair.partition("=")
            if not equals or not value.strip():
                raise click.BadParameter(
                    f"{pair[:60]!r} has no value; write it as NAME=VALUE.", param_hint=f"--{kind}"
                )
            key = f"{kind}:{name.strip()}"
            if key in texts:
                raise stated_twice(kind, name.strip(), name.strip())
            texts[key] = value
    return facts_from_texts(texts)


# A shorter stage is not named while it lasts.
_PATIENCE_SECONDS: Final = 1.0


class Waiting:
    """Times the stages of a command, and names those that last on stderr.

    On a terminal the line shows elapsed seconds and the progress of the stage; elsewhere each stage
    is named once.

    Parameters
    ----------
    source : Path
        What is read: frames that are files of their own have a bar of their own.
    """

    def __init__(self, source: Path) -> None:
        self.watch = Stopwatch(report=self._note)
        has_bar = source.suffix.lower() == ".zip" or not source.is_file()
        self._shown = {"read"} if has_bar else set()
        self._began = time.perf_counter()
        self._stage, self._since = Progress(0.0), self._began
        self._over = threading.Event()
        self._teller = threading.Thread(target=self._tell, daemon=True)

    def __enter__(self) -> Self:
        self._teller.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._teller.join()

    def milliseconds(self) -> dict[str, float]:
        """Give the time of each stage, and of the rest since this was made."""
        stages = dict(self.watch.milliseconds)
        since = 1e3 * (time.perf_counter() - self._began)
        return {**stages, "other": max(0.0, since - sum(stages.values()))}

    def _note(self, progress: Progress) -> None:
        if self._stage.stage != progress.stage:
            self._since = time.perf_counter()
        self._stage = progress

    def _tell(self) -> None:
        is_terminal, width = sys.stderr.isatty(), 0
        while not self._over.wait(_PATIENCE_SECONDS):
            name, done = self._stage.stage, self._stage.share
            if not name or name in self._shown:
                continue
            seconds = time.perf_counter() - self._since
            if is_terminal:
                line = f"{name} {seconds:.0f} s" + (f", {done:.0%}" if done else "")
                click.echo(f"\r{line:<{width}}", nl=False, err=True)
                width = max(width, len(line))
            elif seconds >= _PATIENCE_SECONDS:
                click.echo(f"{name} ...", err=True)
                self._shown.add(name)
        if width:
            click.echo(f"\r{'':<{width}}\r", nl=False, err=True)


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
        formats.ReadOptions,
        *("unit", "format", "frame_interval", "n_vertices", "dtype"),
        group=READING,
        dtype={"type": click.Choice(list(named_arrays.RAW_TYPES))},
    ),
    fact_options,
)
"""FILE, as `source`, and the options that describe it, named as in `ReadOptions`."""


def read(source: Path, *, beside: Sequence[str] = (), **stated: Any) -> MeshSequence:
    """Read a sequence: a file, a folder of frames, or a pattern of their names.

    For a track its sequence is read, with the errors of the track. Frames that
    are files of their own show a progress bar; unused content and assumptions are printed.

    Parameters
    ----------
    source : Path
    beside : sequence of str
        Names of arrays that the caller reads itself.
    **stated
        Fields of `ReadOptions`, and options that state facts.
    """
    options = formats.ReadOptions(facts=stated_facts(stated), **stated)
    with naming(source), counting("frames") as bar:
        result = read_recording(source, options, progress=bar)
    if ignored := [name for name in result.ignored if name not in beside]:
        click.echo(f"not used: {', '.join(ignored)}", err=True)
    for note in result.notes:
        click.echo(f"note: {note}", err=True)
    return result.sequence


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name a file in the errors of reading it, where they do not name it already."""
    try:
        yield
    except errors.ModalMotionError as error:
        raise errors.named(error, "" if f"'{path.name}'" in error.message else path.name) from error


def each_labelled(
    sources: Sequence[Path],
    use: Callable[[TrainingCase], T],
    *,
    skips: bool,
    facts: Facts = NO_FACTS,
    **stated: Any,
) -> tuple[list[T], list[cases.LeftOut]]:
    """Read recordings one by one, each for a use.

    Parameters
    ----------
    sources : sequence of Path
        A manifest, or files.
    use : callable
    skips : bool
        Whether those that cannot be used are left out.
    facts : Facts
        Over those of the manifest.
    **stated
        Fields of `ReadOptions`.

    Returns
    -------
    used : list
    left_out : list of LeftOut
    """
    from modalmotion.classification import cases, manifest

    used: list[T] = []
    left_out: list[cases.LeftOut] = []
    files = manifest.labelled_files(sources, skip_unreadable=skips, needs_label=False)
    with progress_bar(files, label="recordings") as bar:
        for file in bar:
            source = manifest.LabelledSequence(replace(file, facts=facts.over(file.facts)), stated)
            try:
                used.append(use(source.read()))
            except cases.UNUSABLE as error:
                is_named = source.name in error.message
                if not skips:
                    raise errors.named(error, "" if is_named else source.name) from error
                left_out.append(cases.LeftOut.of(error, source.name))
    return used, left_out


def fitted(
    source: Path, waiting: Waiting, options: dict[str, Any]
) -> tuple[MeshSequence, ModalSignature]:
    """Read a sequence and fit its signature with the options of a command."""
    parameters = signature_parameters(options)
    with waiting.watch.stage("read"):
        sequence = read(source, **options)
    return sequence, modal_signature(sequence, parameters, watch=waiting.watch)


def progress_bar(items: Iterable[Any] | None = None, **options: Any) -> Any:
    """Show a bar on a terminal; where there is none not even its label, which says nothing."""
    hidden = not sys.stderr.isatty()
    return click.progressbar(items, file=sys.stderr, hidden=hidden, **options)


@contextlib.contextmanager
def counting(label: str) -> Iterator[Reporter]:
    """Show a bar of what is done, from the first report on."""
    with contextlib.ExitStack() as open_bar:
        bar: Any = None

        def show(progress: Progress) -> None:
            nonlocal bar
            if bar is None:
                bar = open_bar.enter_context(progress_bar(length=100, label=label))
            bar.update(round(100 * progress.share) - bar.pos)

        yield show
