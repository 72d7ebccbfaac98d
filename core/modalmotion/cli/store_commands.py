"""Commands that maintain a store."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from modalmotion.cli.options import OutputFile, OutputFolder, example, json_option, tell
from modalmotion.representation import counted

if TYPE_CHECKING:
    from modalmotion.exports.signature_pack import PackReport

_FOLDER = click.argument(
    "folder", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="FOLDER"
)
_MOST_NAMED = 20
_OWNER = click.option("--owner", help="Owner of the store, in a service's data folder FOLDER.")


@click.group()
def store() -> None:
    """Maintain a folder of results: back up, restore, verify, rebuild, export.

    Except for `backup`, no server may have it open.
    """


@store.command(epilog=example("store rebuild results"))
@_FOLDER
@_OWNER
@json_option
def rebuild(folder: Path, owner: str | None, as_json: bool) -> None:
    """Rebuild the index of each store in FOLDER from its files."""
    _tell_rebuilt({}, [], _stores_of(folder, owner), as_json=as_json)


def _tell_rebuilt(
    answer: dict[str, object], said: list[str], stores: list[tuple[str, Path]], *, as_json: bool
) -> None:
    """Rebuild stores one after the other, and report."""
    rebuilt = {}
    if not as_json:
        tell({}, said, as_json=False)
    for name, root in stores:
        lines, rebuilt[_owner_of(name)] = _rebuild(name, root)
        if not as_json:
            tell({}, lines, as_json=False)
    if as_json:
        tell({**answer, "stores": rebuilt}, [], as_json=True)


def _owner_of(name: str) -> str:
    return name.removesuffix(": ") or "local"


def _rebuild(name: str, root: Path) -> tuple[list[str], dict[str, object]]:
    from modalmotion.store import backup_time
    from modalmotion.store import rebuild as run

    said = []
    time = backup_time(root)
    if time is not None:
        said.append(
            f"{name}This is a backup as of {time}: what was deleted since is in it again. "
            "`modalmotion store restore` looks for deletions."
        )
    with _progress("reading files") as progress:
        result = run(root, progress=progress)
    said.append(
        f"{name}{result.n_sequences} sequences, {result.n_results} results, {result.n_models} "
        "models are in the index"
    )
    for what, number in (
        ("deletions finished", result.n_deletions),
        ("unfinished files removed", result.n_temporaries),
    ):
        if number:
            said.append(f"{name}{number} {what}")
    for what, files in (
        ("record written anew", result.restored),
        ("damaged", result.damaged),
        ("belongs to nothing", result.orphans),
    ):
        said += [f"{name}{file}: {what}" for file in files]
    if result.guests_lost:
        said.append(f"{name}The index was damaged: jobs and idempotency keys are lost.")
    answer = {"backup_time": time, **asdict(result)}
    return said, answer


@store.command(epilog=example("store verify results"))
@_FOLDER
@_OWNER
@json_option
def verify(folder: Path, owner: str | None, as_json: bool) -> None:
    """Check every file of each store in FOLDER; the exit code is 1 if something is wrong."""
    # All stores, even if the first has faults.
    answers, are_sound = {}, []
    for name, root in _stores_of(folder, owner):
        said, answer = _verify(name, root)
        answers[_owner_of(name)] = answer
        are_sound.append(answer["is_sound"])
        if not as_json:
            tell({}, said, as_json=False)
    if as_json:
        tell({"stores": answers}, [], as_json=True)
    if not all(are_sound):
        raise click.exceptions.Exit(1)


def _verify(name: str, root: Path) -> tuple[list[str], dict[str, object]]:
    from modalmotion.store import backup_time
    from modalmotion.store import verify as run

    with _progress("reading files") as progress:
        report = run(root, progress=progress)
    said = []
    time = backup_time(root)
    if time is not None:
        said.append(f"{name}This is a backup as of {time}: what was deleted since is still in it.")
    said += [f"{name}{fault.file}: {fault.problem}" for fault in report.faults]
    said += [
        f"{name}{file}: left by a crash; opening the store settles it" for file in report.unfinished
    ]
    said += [f"{name}{file}: belongs to nothing" for file in report.orphans]
    n_faults = len(report.faults)
    verdict = "sound" if report.is_sound else f"{n_faults} fault{'s' * (n_faults > 1)}"
    said.append(
        f"{name}{report.n_sequences} sequences, {report.n_results} results, {report.n_models} "
        f"models, {report.n_bytes / 1e6:.1f} MB: {verdict}"
    )
    answer = {"is_sound": report.is_sound, "backup_time": time, **asdict(report)}
    return said, answer


@store.command(epilog=example("store export results signatures.h5"))
@_FOLDER
@click.argument("out", type=OutputFile(), metavar="OUT.h5")
@_OWNER
@json_option
def export(folder: Path, out: Path, owner: str | None, as_json: bool) -> None:
    """Pack all signatures of the store in FOLDER, its own if no owner is named, into one file.

    The exit code is 1 if a signature is damaged; the others are packed all the same.
    """
    from modalmotion.errors import NotFoundError
    from modalmotion.exports.signature_pack import export as run

    others = [name for name in _owners_in(folder) if name != owner]
    try:
        with _progress("packing signatures") as progress:
            report = run(_store_of(folder, owner), out, progress=progress)
    except NotFoundError as error:
        if not others:
            raise
        raise NotFoundError(
            error.message, remedy=f"Name another owner of FOLDER: --owner {' or '.join(others)}."
        ) from error
    said = counted(report.n_signatures, "signature")
    tell(asdict(report), [said], out, as_json=as_json)
    if owner is None and others:
        click.echo(f"Those of other owners are not in it: --owner {' or '.join(others)}.", err=True)
    require_all_packed(report)


def require_all_packed(report: PackReport) -> None:
    """Print the signatures that an export had to leave out, and end with 1 if there are any."""
    for sequence_id, reason in report.failures:
        click.echo(f"{sequence_id[:12]}: {reason}", err=True)
    if report.failures:
        raise click.exceptions.Exit(1)


@store.command(epilog=example("store backup results copy"))
@_FOLDER
@click.argument("copy", type=OutputFolder(), metavar="COPY")
@click.option(
    "--accept-missing",
    is_flag=True,
    help="Continue without files that FOLDER has lost: they are removed from COPY, too.",
)
@json_option
def backup(folder: Path, copy: Path, accept_missing: bool, as_json: bool) -> None:
    """Copy the store in FOLDER to the folder COPY; a server may have it open.

    Run again, it copies new files, and removes those that were deleted since. Files that are
    missing without having been deleted remain in COPY and are named; the exit code is then 1.
    """
    from modalmotion.store import backup as run

    with _progress("copying") as progress:
        report = run(folder, copy, accept_missing=accept_missing, progress=progress)
    said = (
        f"{report.n_files} files, {report.n_bytes / 1e6:.1f} MB: {report.n_copied} copied, "
        f"{report.n_removed} removed: {copy}"
    )
    tell(asdict(report), [said], as_json=as_json)
    if not report.missing:
        return
    for file in report.missing[:_MOST_NAMED]:
        click.echo(f"{file}: missing in {folder}, and nobody deleted it", err=True)
    if len(report.missing) > _MOST_NAMED:
        click.echo(f"... and {len(report.missing) - _MOST_NAMED} more", err=True)
    raise click.ClickException(
        f"{folder} has lost {len(report.missing)} files; {copy} keeps what it has of them. Put "
        f"them back: stop the server, `modalmotion store restore {copy} {folder}`. Or go on "
        "without them: `modalmotion store rebuild`, then this command with --accept-missing."
    )


@store.command(epilog=example("store restore copy results"))
@click.argument(
    "copy", type=click.Path(exists=True, file_okay=False, path_type=Path), metavar="COPY"
)
@click.argument("folder", type=OutputFolder(), metavar="FOLDER")
@click.option(
    "--deletions",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Remains of the old folder: what was deleted there is not restored.",
)
@json_option
def restore(copy: Path, folder: Path, deletions: Path | None, as_json: bool) -> None:
    """Restore what is missing in FOLDER from its backup COPY, and rebuild its indices.

    FOLDER may be new. Nothing in it is replaced, and nothing with a tombstone is restored.
    """
    from modalmotion.store import restore as run

    with _progress("copying") as progress:
        report = run(copy, folder, deletions=deletions, progress=progress)
    said = [f"{report.n_files} files, {report.n_bytes / 1e6:.1f} MB put back, as of {report.as_of}"]
    if report.n_deleted:
        said.append(f"{report.n_deleted} files stay away: they were deleted since")
    if not report.knows_deletions:
        said.append(
            f"What was deleted after {report.as_of} is in {folder} again: nothing here tells what "
            "that was. Remains of the old folder may: name them with --deletions."
        )
    answer = asdict(report)
    _tell_rebuilt(answer, said, _stores_of(folder, None), as_json=as_json)


def _stores_of(folder: Path, owner: str | None) -> list[tuple[str, Path]]:
    """List stores with the prefix of their output lines; all of a service by default."""
    others = _owners_in(folder)
    if owner is not None or not others:
        return [("", _store_of(folder, owner))]
    return [("local: ", folder), *((f"{name}: ", folder / "owners" / name) for name in others)]


def _store_of(folder: Path, owner: str | None) -> Path:
    if owner in (None, "local"):
        return folder
    others = _owners_in(folder)
    if owner not in others:
        raise click.BadParameter(
            f"{folder} has no store of {owner!r}, only of {', '.join(['local', *others])}.",
            param_hint="--owner",
        )
    return folder / "owners" / owner


def _owners_in(folder: Path) -> list[str]:
    """List owners with a store beside that of the folder itself, without those under removal."""
    return sorted(
        path.name
        for path in (folder / "owners").glob("*")
        if path.is_dir() and re.fullmatch(r"[a-z0-9][a-z0-9_-]*", path.name)
    )


@contextmanager
def _progress(label: str) -> Iterator[Callable[[int, int], None]]:
    # The number of files is known only when the work has begun.
    with click.progressbar(length=1, label=label, file=sys.stderr) as bar:

        def show(done: int, total: int) -> None:
            bar.length = total
            bar.update(done - bar.pos)

        yield show
