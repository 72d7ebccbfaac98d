"""Commands that look after a store: rebuild, verify and export."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from modalmotion.cli.options import example

if TYPE_CHECKING:
    from modalmotion.exports.signature_pack import PackReport

_FOLDER = click.argument(
    "folder", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="FOLDER"
)
_OWNER = click.option("--owner", help="Owner of the store, in a service's data folder FOLDER.")


@click.group()
def store() -> None:
    """Look after a folder of results: back up, verify, rebuild, export.

    Except for `backup`, no server may have it open.
    """


@store.command(epilog=example("store rebuild results"))
@_FOLDER
@_OWNER
def rebuild(folder: Path, owner: str | None) -> None:
    """Build the index of each store in FOLDER anew from its files.

    Files that an older version of modalmotion wrote are rewritten first.
    """
    for name, root in _stores_of(folder, owner):
        _rebuild(name, root)


def _rebuild(name: str, root: Path) -> None:
    from modalmotion.store import rebuild as run

    with _progress("reading files") as progress:
        result = run(root, progress=progress)
    click.echo(
        f"{name}{result.n_sequences} sequences, {result.n_results} results, {result.n_models} "
        "models are in the index"
    )
    for kind, number in sorted(result.rewritten.items()):
        what = f"{kind} file{'s' * (number > 1)}"
        click.echo(f"{name}{number} {what} of an older version rewritten")
    for file, why in sorted(result.refused.items()):
        click.echo(f"{name}{file}: of an older version, and could not be taken: {why}")
    for what, number in (
        ("deletions finished", result.n_deletions),
        ("unfinished files removed", result.n_temporaries),
    ):
        if number:
            click.echo(f"{name}{number} {what}")
    for what, files in (
        ("record written anew", result.restored),
        ("damaged", result.damaged),
        ("belongs to nothing", result.orphans),
    ):
        for file in files:
            click.echo(f"{name}{file}: {what}")
    if result.guests_lost:
        click.echo(f"{name}The index was damaged: jobs and idempotency keys are lost.")


@store.command(epilog=example("store verify results"))
@_FOLDER
@_OWNER
def verify(folder: Path, owner: str | None) -> None:
    """Check every file of each store in FOLDER; ends with 1 if something is wrong."""
    # All stores, even if the first has faults.
    are_sound = [_verify(name, root) for name, root in _stores_of(folder, owner)]
    if not all(are_sound):
        raise click.exceptions.Exit(1)


def _verify(name: str, root: Path) -> bool:
    from modalmotion.store import verify as run

    with _progress("reading files") as progress:
        report = run(root, progress=progress)
    for fault in report.faults:
        click.echo(f"{name}{fault.file}: {fault.problem}")
    for file in report.unfinished:
        click.echo(f"{name}{file}: left by a crash; opening the store settles it")
    for file in report.orphans:
        click.echo(f"{name}{file}: belongs to nothing")
    n_faults = len(report.faults)
    verdict = "sound" if report.is_sound else f"{n_faults} fault{'s' * (n_faults > 1)}"
    click.echo(
        f"{name}{report.n_sequences} sequences, {report.n_results} results, {report.n_models} "
        f"models, {report.n_bytes / 1e6:.1f} MB: {verdict}"
    )
    return report.is_sound


@store.command(epilog=example("store export results signatures.h5"))
@_FOLDER
@click.argument("out", type=click.Path(dir_okay=False, path_type=Path), metavar="OUT.h5")
@_OWNER
def export(folder: Path, out: Path, owner: str | None) -> None:
    """Pack all signatures of the store in FOLDER, its own if no owner is named, into one file.

    Ends with 1 if a signature is damaged; the others are packed then all the same.
    """
    from modalmotion.errors import NotFoundError
    from modalmotion.exports.signature_pack import export as run

    try:
        with _progress("packing signatures") as progress:
            report = run(_store_of(folder, owner), out, progress=progress)
    except NotFoundError as error:
        owners = [path.name for path in _owners_in(folder)]
        if owner is not None or not owners:
            raise
        raise NotFoundError(
            error.message, remedy=f"Name an owner of FOLDER: --owner {' or '.join(owners)}."
        ) from error
    click.echo(f"{report.n_signatures} signatures written: {out}")
    require_all_packed(report)


def require_all_packed(report: PackReport) -> None:
    """Print the signatures that an export had to leave out, and end with 1 if there are any."""
    for sequence_id, reason in report.failures:
        click.echo(f"{sequence_id[:12]}: {reason}", err=True)
    if report.failures:
        raise click.exceptions.Exit(1)


@store.command(epilog=example("store backup results copy"))
@_FOLDER
@click.argument("copy", type=click.Path(file_okay=False, path_type=Path), metavar="COPY")
def backup(folder: Path, copy: Path) -> None:
    """Copy the store in FOLDER to the folder COPY; a server may have it open.

    Run again, it copies new files, and removes those deleted since.
    """
    from modalmotion.store import backup as run

    with _progress("copying") as progress:
        report = run(folder, copy, progress=progress)
    click.echo(
        f"{report.n_files} files, {report.n_bytes / 1e6:.1f} MB: {report.n_copied} copied, "
        f"{report.n_removed} removed: {copy}"
    )


def _stores_of(folder: Path, owner: str | None) -> list[tuple[str, Path]]:
    """List stores with the prefix of their output lines; all of a service by default."""
    others = _owners_in(folder)
    if owner is not None or not others:
        return [("", _store_of(folder, owner))]
    return [("local: ", folder), *((f"{path.name}: ", path) for path in others)]


def _owners_in(folder: Path) -> list[Path]:
    return [path for path in sorted((folder / "owners").glob("*")) if path.is_dir()]


def _store_of(folder: Path, owner: str | None) -> Path:
    if owner in (None, "local"):
        return folder
    store_folder = folder / "owners" / str(owner)
    if re.fullmatch(r"[a-z0-9][a-z0-9_-]*", str(owner)) is None or not store_folder.is_dir():
        raise click.BadParameter(f"{folder} has no store of {owner!r}.", param_hint="--owner")
    return store_folder


@contextmanager
def _progress(label: str) -> Iterator[Callable[[int, int], None]]:
    # The number of files is known only when the work has begun.
    with click.progressbar(length=1, label=label, file=sys.stderr) as bar:

        def show(done: int, total: int) -> None:
            bar.length = total
            bar.update(done - bar.pos)

        yield show
