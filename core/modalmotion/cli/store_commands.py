"""Commands that maintain a store."""

import re
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import click

from modalmotion.cli import shared
from modalmotion.cli.files import counting
from modalmotion.notes import Note

_FOLDER = click.argument("folder", type=shared.EXISTING_FOLDER, metavar="FOLDER")


@click.group()
def store() -> None:
    """Maintain a folder of results: back up, restore, verify, rebuild, export.

    Except for `backup`, no server may have it open.
    """


@shared.command("store rebuild results", group=store)
@_FOLDER
def rebuild(folder: Path, owner: str | None = None) -> Any:
    """Rebuild the index of each store in FOLDER from its files.

    Parameters
    ----------
    owner
        Owner of the store, in a service's data folder FOLDER.
    """
    return _rebuilt(_stores_of(folder, owner))


def _rebuilt(stores: dict[str, Path]) -> dict[str, Any]:
    from modalmotion.store import rebuild as run

    return _each(stores, run, lambda report: ["index_damaged"] * report.service_tables_lost)


def _each(
    stores: dict[str, Path], run: Callable[..., Any], codes: Callable[[Any], list[str]], *more: str
) -> dict[str, Any]:
    """Give what becomes of each store, even if the first has faults; with `more` of the report."""
    from modalmotion.store import backup_time

    answer = {}
    for name, root in stores.items():
        time = backup_time(root)
        with counting("reading files") as progress:
            report = run(root, progress=progress)
        notes = [Note.of(code) for code in (*["is_backup"] * (time is not None), *codes(report))]
        found = {**shared.members(report, *more), "backup_time": time, **asdict(report)}
        answer[name] = {**found, "notes": notes}
    return {"stores": answer}


@shared.command("store verify results", group=store)
@_FOLDER
def verify(folder: Path, owner: str | None = None) -> Any:
    """Check every file of each store in FOLDER; the exit code is 1 if something is wrong.

    Parameters
    ----------
    owner
        Owner of the store, in a service's data folder FOLDER.
    """
    from modalmotion.store import verify as run

    stores = _stores_of(folder, owner)
    whole = _each(stores, run, lambda one: ["left_by_crash"] * bool(one.unfinished), "is_sound")
    is_wrong = not all(one["is_sound"] for one in whole["stores"].values())
    return whole, shared.described(whole), click.exceptions.Exit(1) if is_wrong else None


@shared.command("store export results signatures.h5", group=store)
@_FOLDER
@click.argument("out", type=shared.OutputFile(), metavar="OUT.h5")
def export(folder: Path, out: Path, owner: str | None = None) -> Any:
    """Pack all signatures of the store in FOLDER, its own if no owner is named, into one file.

    The exit code is 1 if a signature is damaged; the others are packed nevertheless.

    Parameters
    ----------
    owner
        Owner of the store, in a service's data folder FOLDER.
    """
    from modalmotion.errors import NotFoundError
    from modalmotion.exports.signature_pack import export as run

    others = [name for name in _owners_in(folder) if name != owner]
    try:
        with counting("packing signatures") as progress:
            report = run(_store_of(folder, owner), out, progress=progress)
    except NotFoundError as error:
        if not others:
            raise
        raise NotFoundError(
            error.message, remedy=f"Name another owner of FOLDER: --owner {' or '.join(others)}."
        ) from error
    notes = []
    if owner is None and others:
        notes = [Note.of("other_owners", owners=" or ".join(others))]
    failure = click.exceptions.Exit(1) if report.failures else None
    answer = asdict(report)
    failures = [{"sequence": name[:12], "reason": reason} for name, reason in report.failures]
    return answer, shared.described({**answer, "failures": failures, "notes": notes}), failure


@shared.command("store backup results copy", group=store)
@_FOLDER
@click.argument("copy", type=shared.OutputFolder(), metavar="COPY")
def backup(folder: Path, copy: Path, accept_missing: bool = False) -> Any:
    """Copy the store in FOLDER to the folder COPY; a server may have it open.

    Run again, it copies new files, and removes those that were deleted since. Files that are
    missing without having been deleted remain in COPY and are named; the exit code is then 1.

    Parameters
    ----------
    accept_missing
        Continue without files that FOLDER has lost: they are removed from COPY, too.
    """
    from modalmotion.store import backup as run

    with counting("copying") as progress:
        report = run(folder, copy, accept_missing=accept_missing, progress=progress)
    failure = None
    if report.missing:
        failure = click.ClickException(
            f"{folder} has lost {len(report.missing)} files; {copy} keeps what it has of them. Put "
            f"them back: stop the server, `modalmotion store restore {copy} {folder}`. Or go on "
            "without them: `modalmotion store rebuild`, then this command with --accept-missing."
        )
    return asdict(report), shared.described(asdict(report)), failure


@shared.command("store restore copy results", group=store)
@click.argument("copy", type=shared.EXISTING_FOLDER, metavar="COPY")
@click.argument("folder", type=shared.OutputFolder(), metavar="FOLDER")
def restore(
    copy: Path, folder: Path, deletions: Annotated[Path | None, shared.EXISTING_FOLDER] = None
) -> Any:
    """Restore what is missing in FOLDER from its backup COPY, and rebuild its indices.

    FOLDER may be new. Nothing in it is replaced, and nothing with a tombstone is restored.

    Parameters
    ----------
    deletions
        Remains of the old folder: what was deleted there is not restored.
    """
    from modalmotion.store import restore as run

    with counting("copying") as progress:
        report = run(copy, folder, deletions=deletions, progress=progress)
    note = Note.of("deletions_unknown", since=str(report.as_of), folder=str(folder))
    notes = [] if report.knows_deletions else [note]
    return {**asdict(report), **_rebuilt(_stores_of(folder, None)), "notes": notes}


def _stores_of(folder: Path, owner: str | None) -> dict[str, Path]:
    """List stores by owner; all of a service by default."""
    if owner is not None:
        return {owner: _store_of(folder, owner)}
    return {"local": folder, **{name: folder / "owners" / name for name in _owners_in(folder)}}


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
