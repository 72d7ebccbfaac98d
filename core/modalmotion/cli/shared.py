"""Options that several commands share, what they print, and the files they write."""

import functools
import inspect
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, asdict, fields
from enum import Enum
from functools import reduce
from importlib.util import find_spec
from operator import attrgetter
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Final,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import click

from modalmotion import errors, formats, notes
from modalmotion.exports.reading import PICTURES as PICTURES
from modalmotion.exports.reading import write_picture as write_picture
from modalmotion.mesh.sequence import MEAN, Reference
from modalmotion.representation import numeral, plain
from modalmotion.signature.parameters import USUAL_MODES, SignatureParameters

MOVING: Final = ".gif"
"""Suffix of a moving picture."""


class _Output(click.Path):
    """A path to write to, unless there is a reason that it cannot be.

    Parameters
    ----------
    *suffixes : str
        Of files that are written there, in small letters.
    """

    def __init__(self, *suffixes: str) -> None:
        super().__init__(path_type=Path)
        self.suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check it."""
        path = Path(str(super().convert(value, param, ctx)))
        try:
            obstacle = self.obstacle(path)
        except OSError as error:
            obstacle = f"'{path}' cannot be reached ({error.strerror}); name another."
        if obstacle:
            self.fail(obstacle, param, ctx)
        return path

    def obstacle(self, path: Path) -> str:
        """Reason why it cannot be written, with what to do; empty if it can."""
        raise NotImplementedError


class OutputFile(_Output):
    """A file to write: its suffix is known, its folder is there and can be written to."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check it, and that no other option names it."""
        path = super().convert(value, param, ctx)
        for name, other in ctx.params.items() if ctx is not None else ():
            if isinstance(other, Path) and other == path and _is_output(ctx, name):
                self.fail(f"{path.name} is named twice; name two files.", param, ctx)
        return path

    def obstacle(self, path: Path) -> str:
        """Reason why the file cannot be written."""
        if self.suffixes and path.suffix.lower() not in self.suffixes:
            return f"{path.name} ends with none of {', '.join(self.suffixes)}."
        if self.suffixes and path.suffix.lower() in (*PICTURES, MOVING):
            require_matplotlib()
        if path.is_dir():
            return f"'{path}' is a folder; add the name of the file."
        if path.exists() and not path.is_file():
            return f"'{path}' is a device, not a file; name a file."
        if not path.parent.exists():
            return f"The folder '{path.parent}' does not exist; make it first."
        return _obstacle_in(path.parent)


class OutputFolder(_Output):
    """A folder to write to, which exists or can be made; or one of the files it would contain."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check it, or the nearest folder above that is there."""
        if Path(str(value)).suffix.lower() in self.suffixes:
            return OutputFile().convert(value, param, ctx)
        if "://" in str(value):
            self.fail(f"'{value}' is no folder of this machine; name one that is.", param, ctx)
        return super().convert(value, param, ctx)

    def obstacle(self, path: Path) -> str:
        """Reason why nothing can be written there."""
        return _obstacle_in(next(p for p in (path, *path.absolute().parents) if p.exists()))


def require_matplotlib() -> None:
    """Refuse pictures where nothing draws them."""
    with errors.needs_extra("plot"):
        if find_spec("matplotlib") is None:
            raise ModuleNotFoundError(name="matplotlib")


def _is_output(ctx: click.Context | None, name: str) -> bool:
    parameters = [] if ctx is None else ctx.command.params
    return any(p.name == name and isinstance(p.type, OutputFile) for p in parameters)


def _obstacle_in(folder: Path) -> str:
    if not folder.is_dir():
        return f"'{folder}' is a file, not a folder; name a folder."
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"This user may not write in the folder '{folder}'; name another."
    return ""


EXISTING: Final = click.Path(exists=True, path_type=Path)
EXISTING_FILE: Final = click.Path(exists=True, dir_okay=False, path_type=Path)
EXISTING_FOLDER: Final = click.Path(exists=True, file_okay=False, path_type=Path)

E = TypeVar("E", bound=Enum)
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class Member(click.Choice[E]):
    """A member of an enumeration, by its value."""

    def normalize_choice(self, choice: object, ctx: click.Context | None) -> str:
        """Return the text of a member."""
        text = choice.value if isinstance(choice, Enum) else choice
        return super().normalize_choice(text, ctx)


def grid_shape(value: Any) -> tuple[int, ...]:
    """Read a lattice shape such as 32,64."""
    try:
        return value if isinstance(value, tuple) else tuple(map(int, str(value).split(",")))
    except ValueError:
        raise click.BadParameter(f"{value!r} is not a lattice shape; write it as 32,64.") from None


def _reference(value: Any) -> Reference:
    """Read a frame's number, or the mean shape."""
    try:
        return MEAN if value == MEAN else int(str(value))
    except ValueError:
        raise click.BadParameter(f"{value!r} is not a frame; give its number, or {MEAN}.") from None


class Grouped(click.Option):
    """An option listed in help under a heading, after a command's own."""

    def __init__(self, *names: Any, group: str = "", **settings: Any) -> None:
        super().__init__(*names, **settings)
        self.group = group


class Command(click.Command):
    """A command whose own options come first in its help, then those of each group."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a command's own options, then those of each group."""
        groups: dict[str, list[tuple[str, str]]] = {"": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                groups.setdefault(getattr(parameter, "group", ""), []).append(record)
        for title, records in sorted(groups.items(), key=lambda of: _GROUPS.index(of[0])):
            with formatter.section(title or "Options"):
                formatter.write_dl(records)


FIT: Final = "Fit"
READING: Final = "Reading FILE"
FACTS: Final = "Facts of FILE"
TRACKING: Final = "Tracking"
VENTRICLE: Final = "Ventricle"
_GROUPS: Final = ("", FIT, TRACKING, READING, FACTS, VENTRICLE)
"""Headings of options, in their order."""


def command(
    line: str, *, group: click.Group | None = None, prints_json: bool = True
) -> Callable[[Callable[..., Any]], click.Command]:
    """Make a command with this example at the end of its help, which prints what is returned.

    Parameters of the function that no other decorator makes options of become options: by their
    names, types and defaults, with the help that its docstring gives of each. `Annotated` adds a
    type of click or settings; `output` and `out` are -o too.

    That is a JSON object, which `described` writes in words; or the object and lines in words; or
    both and the error to raise afterwards. The files of all options are listed, unless the member
    `written` lists others.

    Parameters
    ----------
    line : str
    group : click.Group, optional
    prints_json : bool
    """

    def decorate(function: Callable[..., Any]) -> click.Command:
        _own_options(function)(function)
        text = inspect.cleandoc(function.__doc__ or "").partition("\n\nParameters\n")[0]

        @functools.wraps(function)
        def printed(*, as_json: bool = False, **options: Any) -> None:
            found = function(**options)
            answer, *rest = found if isinstance(found, tuple) else (found or {},)
            written = answer.pop("written", None)
            if written is None:
                context = click.get_current_context()
                written = [path for name, path in options.items() if _is_output(context, name)]
            lines = rest[0] if rest else described(answer)
            tell(answer, lines, *written, as_json=as_json)
            if len(rest) > 1 and rest[1] is not None:
                raise rest[1]

        # Options of the function come before --json in the help: lists of click are reversed.
        own, printed.__click_params__ = getattr(function, "__click_params__", []), []  # type: ignore[attr-defined]
        made = json_option(printed) if prints_json else printed
        made.__click_params__ += own  # type: ignore[attr-defined]
        add = click.command if group is None else group.command
        return add(cls=Command, epilog=example(line), help=text)(made)

    return decorate


def several(*options: Decorator) -> Decorator:
    """Join options to one decorator; help lists them in this order."""
    return lambda function: reduce(lambda made, add: add(made), reversed(options), function)


def options_of(kind: type, /, *names: str, group: str = "", **own: Mapping[str, Any]) -> Decorator:
    """Make options of the fields of a parameter class.

    Names, types and defaults are those of the class; the help is the first sentence about a field
    in its docstring.

    Parameters
    ----------
    kind : type
    *names : str
        Of the fields, in the order of the help.
    group : str
        Heading in the help.
    **own
        Settings of click for a field, over these; `flag` is another name of the option.
    """
    helps, taken = helps_of(kind), inspect.signature(kind).parameters
    hints = get_type_hints(kind)
    ranges = {one.name: one.metadata["range"] for one in fields(kind) if "range" in one.metadata}
    made = []
    for name in names:
        hint = getattr(hints[name], "type", hints[name])
        bounds = {"type": click.FloatRange(*ranges[name])} if name in ranges else {}
        settings = {"help": helps.get(name), "group": group, **bounds, **dict(own.get(name) or {})}
        made.append(_option(name, hint, taken[name].default, settings))
    return several(*made)


def _own_options(function: Callable[..., Any]) -> Decorator:
    """Make options of the parameters that nothing else makes arguments or options of."""
    known = {one.name for one in getattr(function, "__click_params__", ())}
    hints = get_type_hints(function, include_extras=True)
    helps = {name: " ".join(said.split()) for name, _, said in _entries(function)}
    return several(
        *(
            _option(
                name,
                hints[name],
                one.default,
                {"help": helps.get(name), "required": one.default is one.empty},
            )
            for name, one in inspect.signature(function).parameters.items()
            if name not in known and one.kind is not one.VAR_KEYWORD
        )
    )


def _option(name: str, hint: Any, default: Any, settings: Mapping[str, Any]) -> Decorator:
    """Make an option of a parameter, with these settings of click over what its type says."""
    default = None if default is inspect.Parameter.empty or default is MISSING else default
    settings = {
        "default": default.value if isinstance(default, Enum) else default,
        **_kind_of(hint, is_repeated=isinstance(default, tuple)),
        **settings,
    }
    flag = str(settings.pop("flag", name)).replace("_", "-")
    if settings["default"] is True:
        flag = f"{flag}/--no-{flag}"
    is_shown = not (
        settings["default"] is None or settings["default"] is False or settings["default"] == ()
    )
    settings.setdefault("show_default", is_shown)
    short = settings.pop("short", ("-o",) if name in ("output", "out") else ())
    if settings.get("required"):
        # Even None would be a default.
        del settings["default"]
    return click.option(*short, f"--{flag}", name, cls=Grouped, **settings)


_ENTRY: Final = re.compile(r"^ {4}(\w[\w, ]*)(?: : (.*))?\n((?:(?: {8}.*)?\n)*)", re.MULTILINE)
_UNITS: Final = re.compile(r", (mm|s|degrees)\b")


def _entries(of: Any) -> Iterator[tuple[str, str, str]]:
    """Give name, type and text of each parameter that a docstring describes."""
    for names, kind, text in _ENTRY.findall((of.__doc__ or "") + "\n"):
        yield from ((name, kind, text) for name in names.split(", "))


def helps_of(kind: type) -> dict[str, str]:
    """Give the first sentence that a class's docstring says of each parameter, with its unit."""
    said = dict[str, str]()
    for name, of, text in _entries(kind):
        sentence = re.split(r"(?<=[.;])\s", " ".join(text.split()))[0].replace("`", "").rstrip(";.")
        unit = _UNITS.search(of)
        said[name] = f"{sentence}{f' ({unit[1]})' if unit else ''}."
    return said


def _kind_of(hint: Any, *, is_repeated: bool = False) -> dict[str, Any]:
    """Give click's settings for an annotation; `Annotated` has a type of click, or settings."""
    if get_origin(hint) is Annotated:
        hint, *more = get_args(hint)
        kind = _kind_of(hint, is_repeated=is_repeated)
        for one in more:
            kind |= one if isinstance(one, dict) else {"type": one}
        return kind
    if hint == Reference:
        return {"type": _reference, "metavar": "FRAME|mean"}
    if get_origin(hint) in (Union, UnionType):
        hint = next(one for one in get_args(hint) if one is not NoneType)
    if is_repeated:
        return {**_kind_of(get_args(hint)[0]), "multiple": True}
    if hint is bool:
        return {"is_flag": True}
    if hint is Path:
        return {"type": click.Path(path_type=Path)}
    if get_origin(hint) is Literal:
        return {"type": click.Choice(get_args(hint), case_sensitive=False)}
    if get_origin(hint) is tuple:
        return {"type": grid_shape, "metavar": "N,N'"}
    if isinstance(hint, type) and issubclass(hint, Enum):
        return {"type": Member(hint)}
    return {"type": hint if hint in (int, float) else str}


mode_options = options_of(
    SignatureParameters,
    *("modes", "amplitudes", "tolerance", "tolerance_of", "auto"),
    "harmonics",
    group=FIT,
    modes={"show_default": str(USUAL_MODES)},
)
"""How many modes, in one of several ways."""

surface_options = several(
    options_of(SignatureParameters, "topology", group=FIT),
    options_of(formats.ReadOptions, "grid", group=FIT),
)
fit_options = several(
    mode_options,
    surface_options,
    options_of(
        SignatureParameters,
        *("reference", "components", "kind", "remove_rotation", "volumes", "deviations"),
        group=FIT,
    ),
)
"""What a signature is fitted with, as `signature_parameters` takes it."""

Plot = Annotated[Path | None, OutputFile(*PICTURES)]
"""A picture to write."""
OnlyPlot = Annotated[Plot, {"short": ("-o",)}]
"""The same of commands that write nothing else."""
Cases = Annotated[Path | None, OutputFile(".csv"), {"flag": "cases"}]
"""The table of held-out cases."""
Coverage = Annotated[float, click.FloatRange(0, 1, min_open=True, max_open=True)]
"""Level of class sets."""
Existing = Annotated[Path | None, EXISTING]
json_option = click.option("--json", "as_json", is_flag=True, help="Print the answer as JSON.")

_PARAMETERS = ("amplitudes", *(field.name for field in fields(SignatureParameters)))


def signature_parameters(options: dict[str, Any]) -> SignatureParameters:
    """Take the parameters of a signature out of the options of a command."""
    names = [name for name in _PARAMETERS if name in options]
    return SignatureParameters(**{name: options.pop(name) for name in names})


def aligned(rows: Sequence[Sequence[object]]) -> str:
    """Write rows, the first a heading, in columns; numbers end below one another."""
    texts = [[str(cell) for cell in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*texts, strict=True)]
    are_numbers = [
        all(cell.replace(".", "", 1).isdigit() for cell in column[1:]) and len(rows) > 1
        for column in zip(*texts, strict=True)
    ]
    return "\n".join(
        "  ".join(
            cell.rjust(width) if is_number else cell.ljust(width)
            for cell, width, is_number in zip(row, widths, are_numbers, strict=True)
        ).rstrip()
        for row in texts
    )


def members(value: object, *names: str, write: Callable[[Any], Any] = plain) -> dict[str, Any]:
    """Give attributes of a value, `path.to.one` or `attribute as name`, for an answer."""
    pairs = (one.partition(" as ") for one in names)
    return {
        name or path.rpartition(".")[2]: write(attrgetter(path)(value)) for path, _, name in pairs
    }


SEQUENCE: Final = ("n_frames", "n_vertices", "unit", "id")
"""Members of an answer about a sequence that was written."""


def example(line: str) -> str:
    """Write the last line of a command's help."""
    return f"Example: modalmotion {line}"


_NOTES: Final = ("notes", "caveats", "flags", "left_out")
_FEW: Final = 8
# Members of an answer that are lengths, in its unit.
_LENGTHS: Final = (
    *("rms", "max_error", "rms_error", "weighted_rms_error", "p95_error", "motion_rms", "noise"),
    *("deviation_across", "deviation_along", "residual_rms", "rms_deviations"),
)


def described(answer: Mapping[str, Any], indent: str = "") -> Iterator[str]:
    """Write an answer in words: a line for each member, a table of several objects, notes."""
    unit = f" {answer['unit']}" if answer.get("unit") else ""
    for name, value in answer.items():
        label = f"{indent}{name.replace('_', ' ').removeprefix('n ')}"
        if name in _NOTES and isinstance(value, list | tuple):
            yield from (
                f"{indent}{'flag' if name == 'flags' else 'note'}: {_words(one)}" for one in value
            )
        elif isinstance(value, Mapping) and value:
            yield f"{label}:"
            yield from described(value, f"{indent}  ")
        elif isinstance(value, list | tuple) and value and isinstance(value[0], Mapping):
            columns = [key for key, one in value[0].items() if not isinstance(one, Mapping)]
            rows = [[_text(one.get(key, "")) for key in columns] for one in value]
            yield f"{label}:"
            heads = [key.replace("_", " ") for key in columns]
            yield from (f"{indent}  {row}" for row in aligned([heads, *rows]).splitlines())
        elif value is not None and (value or not isinstance(value, str | list | tuple | Mapping)):
            yield f"{label:<26} {_text(value)}{unit if name in _LENGTHS else ''}"


def _words(one: Any) -> str:
    """Write a note, or what was a note before it was written as JSON."""
    return str(one["text"] if isinstance(one, Mapping) else one)


def _text(value: Any) -> str:
    """Write a value in words: an interval, the size of a matrix, the range of many numbers."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return numeral(value)
    if not isinstance(value, list | tuple):
        return "" if value is None else str(value)
    known = [one for one in value if one is not None]
    if len(value) > _FEW and known and all(isinstance(one, int | float) for one in known):
        return f"{_text(min(known))} to {_text(max(known))} ({len(value)} values)"
    if value and all(isinstance(one, list | tuple) for one in value):
        return f"{len(value)} x {len(value[0])} values"
    return ", ".join(map(_text, value))


def tell(
    answer: Mapping[str, object], lines: Iterable[str], *written: Path | None, as_json: bool
) -> None:
    """Print an answer and the files that were written: as one JSON object, or in words."""
    if not as_json:
        for line in lines:
            click.echo(line)
        for path in filter(None, written):
            click.echo(f"written: {path}")
        return
    paths = [str(path) for path in written if path is not None]
    whole = {**answer, "written": paths} if paths else dict(answer)
    click.echo(json.dumps(whole, indent=2, default=_plain))


def _plain(value: object) -> object:
    """Give what JSON has a form for."""
    return asdict(value) if isinstance(value, notes.Note) else str(value)


labelled_sources = several(
    click.argument(
        "sources",
        metavar="MANIFEST|FILES...",
        nargs=-1,
        required=True,
        type=click.Path(path_type=Path),
    ),
    click.option(
        "--skip-unreadable",
        is_flag=True,
        help="Continue without files that are missing, unreadable or unlike the others; the "
        "summary names them.",
    ),
)
"""MANIFEST or FILES, as `sources`, and the options of all of them."""
