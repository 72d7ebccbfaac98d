"""Options that several commands share."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import click

from modalmotion.choice.parameters import ErrorKind, ModeOrder, SignatureKind, SignatureParameters
from modalmotion.cli.outputs import PICTURES, OutputFile
from modalmotion.mesh.sequence import MEAN, Reference
from modalmotion.template import Weights
from modalmotion.template.body_frame import Components

E = TypeVar("E", bound=Enum)
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


class Member(click.Choice[E]):
    """A member of an enumeration, by its value."""

    def normalize_choice(self, choice: object, ctx: click.Context | None) -> str:
        """Return the text of a member."""
        text = choice.value if isinstance(choice, Enum) else choice
        return super().normalize_choice(text, ctx)


class GridShape(click.ParamType[tuple[int, ...]]):
    """A lattice shape such as 32,64."""

    name = "N,N'"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        """Read the numbers between commas."""
        if isinstance(value, tuple):
            return value
        try:
            return tuple(int(n) for n in str(value).split(","))
        except ValueError:
            self.fail(f"{value!r} is not a lattice shape; write it as 32,64.", param, ctx)


class ReferenceShape(click.ParamType[Reference]):
    """A frame's number, or the mean shape."""

    name = "FRAME|mean"

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> Reference:
        """Read a number or `MEAN`."""
        if value == MEAN:
            return MEAN
        try:
            return int(str(value))
        except ValueError:
            self.fail(f"{value!r} is not a frame; give its number, or {MEAN}.", param, ctx)


class ReadingOption(click.Option):
    """An option that says how FILE is read: help lists it after a command's own."""


reading_option = partial(click.option, cls=ReadingOption)


class Command(click.Command):
    """A command whose own options come first in its help."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a command's own options, then those of reading FILE."""
        for title, is_reading in (("Options", False), ("Reading FILE", True)):
            of_both = [
                p for p in self.get_params(ctx) if isinstance(p, ReadingOption) == is_reading
            ]
            records = [record for p in of_both if (record := p.get_help_record(ctx))]
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def several(*options: Decorator) -> Decorator:
    """Join options to one decorator; help lists them in this order."""

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def output_option(text: str, *suffixes: str, **settings: Any) -> Decorator:
    """Make the option -o, --output for a file to write, with one of these suffixes if any."""
    kind = OutputFile(*suffixes)
    return click.option("-o", "--output", **{"required": True, "type": kind, **settings}, help=text)


mode_options = several(
    click.option(
        "--modes", type=int, help="Modes, 3 amplitudes a frame each, or 1 offset.  [default: 7]"
    ),
    click.option("--amplitudes", type=int, help="In place of modes: amplitudes a frame."),
    click.option(
        "--split-pairs",
        is_flag=True,
        help="Do not round up to whole cosine-sine pairs: the last one then depends on where "
        "theta is zero.",
    ),
    click.option("--tolerance", type=float, help="Largest error, in mm."),
    click.option(
        "--tolerance-of",
        type=Member(ErrorKind),
        default=ErrorKind.RMS.value,
        show_default=True,
        help="RMS over all vertices and frames, the one by their shares of the surface, or the "
        "largest of any vertex.",
    ),
    click.option("--tolerance-share", type=float, help="Error as a share of the RMS motion."),
    click.option("--auto", is_flag=True, help="Stop where the residual is noise."),
    click.option(
        "--order",
        type=Member(ModeOrder),
        default=ModeOrder.FIXED.value,
        show_default=True,
        help="Which modes come first.",
    ),
    click.option("--most-modes", type=int, help="Limit for tolerance, auto and energy."),
    click.option("--harmonics", type=int, help="Limit each amplitude's path over time."),
)
"""How many modes, in one of several ways."""

surface_options = several(
    click.option("--topology", help="cup, cylinder, plane, ...; overrides the file's own."),
    click.option(
        "--grid", type=GridShape(), help="Lattice shape such as 32,64; overrides the file's own."
    ),
)
reference_option = click.option(
    "--reference",
    type=ReferenceShape(),
    default=0,
    show_default=True,
    help="Frame to measure from, or mean: the mean shape of all frames.",
)
weights_option = click.option(
    "--weights",
    type=Member(Weights),
    default=Weights.AREA.value,
    show_default=True,
    help="How much each vertex counts.",
)
components_option = click.option(
    "--components",
    type=Member(Components),
    default=Components.CARTESIAN.value,
    show_default=True,
    help="x, y, z or radial, tangential, axial.",
)
kind_option = click.option(
    "--kind",
    type=Member(SignatureKind),
    default=SignatureKind.MATERIAL.value,
    show_default=True,
    help="Follow the vertices, or measure the surface along its reference's normals: one amplitude "
    "a mode, wherever on the surface the vertices lie.",
)
rotation_option = click.option(
    "--keep-rotation",
    "remove_rotation",
    flag_value=False,
    default=True,
    help="Leave each frame's rotation in the motion.",
)
volumes_option = click.option(
    "--volumes", is_flag=True, help="Keep the volume that the surface encloses in each frame."
)
deviations_option = click.option(
    "--deviations",
    is_flag=True,
    help="Estimate the noise, and what it makes of each amplitude: a standard deviation.",
)
merge_option = click.option(
    "--merge-vertices/--no-merge-vertices",
    default=True,
    show_default=True,
    help="Whether vertices that coincide in every frame are one vertex of the surface.",
)
plot_option = click.option(
    "--plot", type=OutputFile(*PICTURES), help="Picture to write (.png, .svg, .pdf)."
)
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


def example(line: str) -> str:
    """Write the last line of a command's help."""
    return f"Example: modalmotion {line}"


def tell(
    answer: Mapping[str, object], lines: Iterable[str], *written: Path | None, as_json: bool
) -> None:
    """Print an answer and the files that were written: as one JSON object, or in words."""
    if not as_json:
        for line in lines:
            click.echo(line)
        list_written(*written)
        return
    paths = [str(path) for path in written if path is not None]
    whole = {**answer, "written": paths} if paths else dict(answer)
    click.echo(json.dumps(whole, indent=2, default=str))


def list_written(*paths: Path | None, as_json: bool = False) -> None:
    """Print the files that were written, apart from an answer in JSON."""
    for path in paths:
        if path is not None:
            click.echo(f"written: {path}", err=as_json)


coverage_option = click.option(
    "--coverage",
    default=0.9,
    show_default=True,
    type=click.FloatRange(0, 1, min_open=True, max_open=True),
    help="Probability that the class set holds the true class.",
)
"""Level of class sets, as `coverage`."""
