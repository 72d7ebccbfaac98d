"""The group of all commands; other distributions add theirs as ``modalmotion.commands``."""

from __future__ import annotations

import sys
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import LazyLoader, find_spec, module_from_spec
from typing import Final

import click

from modalmotion.errors import ModalMotionError

COMMANDS: Final = {
    "animate": ("modes_commands", "Animate vibration modes of the surface in FILE."),
    "card": ("model_commands", "Show the training and the performance of MODEL."),
    "classify": ("model_commands", "Classify the motion of the sequence in FILE."),
    "cohort": (
        "cohort_command",
        "Fit a signature to every recording of a manifest, and store the results.",
    ),
    "compare-models": ("model_commands", "Compare two models, on the same labelled sequences."),
    "convert": ("convert_command", "Write the sequence in FILE in another format."),
    "decode": ("codec_commands", "Decode a compressed STREAM, or some of its frames."),
    "dicom": ("dicom_command", "Write DICOM objects of the sequence in FILE, for an archive."),
    "encode": ("codec_commands", "Compress the sequence in FILE at a given error."),
    "evaluate": ("model_commands", "Test MODEL, a file or a name, on labelled sequences."),
    "features": ("features_command", "Write the features of labelled or unlabelled sequences."),
    "modes": ("modes_commands", "List the vibration modes of a lattice or of FILE's surface."),
    "norm": ("norm_commands", "Compare recordings with your own controls."),
    "readouts": (
        "readouts_command",
        "Compute volume, ejection fraction and strain of the cavity in FILE.",
    ),
    "reconstruct": ("analysis_commands", "Write the surfaces superposed from a few modes."),
    "report": ("report_command", "Report on the sequence in FILE: PDF, FHIR, CSV and HTML."),
    "resample": ("resample_command", "Write the surface in FILE at any phase of its cycle."),
    "score": ("score_command", "Compare the motion in ANSWER with the true one in TRUTH."),
    "segment": ("segment_command", "Find a surface in one image of IN, with its stated error."),
    "show": ("show_command", "Show what is in FILE."),
    "signature": ("analysis_commands", "Fit the modal signature of the sequence in FILE."),
    "simulate": ("simulate_command", "Simulate one heartbeat of a left ventricle."),
    "simulate-cohort": (
        "simulate_command",
        "Simulate labelled ventricles that differ in motion, shape and mesh.",
    ),
    "store": (
        "store_commands",
        "Maintain a folder of results: back up, restore, verify, rebuild, export.",
    ),
    "table": ("table_command", "Write amplitudes of the sequence in FILE as CSV."),
    "track": ("track_command", "Track a surface through the frames in IN."),
    "tradeoff": ("tradeoff_command", "Measure error, size and time of each number of modes."),
    "train": ("train_command", "Train a model on labelled sequences."),
    "view": ("view_command", "Write an HTML page of the moving surface in FILE."),
}
"""Module and help line of each; a command's imports happen when it is called."""

MEANT: Final = {
    "help": "--help",
    **dict.fromkeys(("ef", "strain", "volume", "volumes"), "readouts"),
    **dict.fromkeys(("info", "inspect", "load", "read"), "show"),
    "plot": "signature FILE --plot beat.png",
}
"""Commands that are asked for by other names."""


class _Commands(click.Group):
    """Adds registered commands, and reports our own errors without a traceback."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        registered = {entry.name for entry in entry_points(group="modalmotion.commands")}
        return sorted({*super().list_commands(ctx), *COMMANDS, *registered})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in COMMANDS:
            _put_off("f2py", "testing", "polynomial", "ma")
            module = import_module(f".{COMMANDS[cmd_name][0]}", __package__)
            return _command(getattr(module, cmd_name.replace("-", "_")))
        for entry in entry_points(group="modalmotion.commands", name=cmd_name):
            return _command(entry.load())
        return super().get_command(ctx, cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError as error:
            near = [MEANT[args[0]]] if args[0] in MEANT else []
            near = near or get_close_matches(args[0], self.list_commands(ctx), n=2)
            if not near:
                raise
            text = f"{error.message.rstrip('.')}. Did you mean {' or '.join(near)}?"
            raise click.UsageError(text, ctx) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, self._line(ctx, name)) for name in self.list_commands(ctx)])

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except ModalMotionError as error:
            raise click.ClickException(str(error)) from error

    def _line(self, ctx: click.Context, name: str) -> str:
        if name in COMMANDS:
            return COMMANDS[name][1]
        for entry in entry_points(group="modalmotion.commands", name=name):
            # A distribution may hold its lines beside its commands, so that no command is imported.
            lines = getattr(import_module(entry.module.rpartition(".")[0]), "LINES", {})
            if name in lines:
                return str(lines[name])
        command = self.get_command(ctx, name)
        return "" if command is None else command.get_short_help_str(limit=80)


def _put_off(*parts: str) -> None:
    """Let parts of NumPy that SciPy names and no command uses be imported at their first use.

    SciPy's `from numpy import *` takes each, a fifth of what a short command costs.
    """
    import numpy

    for part in parts:
        name = f"numpy.{part}"
        spec = None if name in sys.modules else find_spec(name)
        if spec is None or spec.loader is None:
            continue
        spec.loader = LazyLoader(spec.loader)
        module = sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(module)
        setattr(numpy, part, module)


def _command(value: object) -> click.Command | None:
    return value if isinstance(value, click.Command) else None


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="modalmotion")
def main() -> None:
    """Modal signatures and classes of nonrigidly moving surfaces."""
