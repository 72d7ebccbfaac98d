"""Commands for owners: what each has, and the removal of one with everything."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Final, get_args

import click

from modalmotion.cli.shared import example, json_option, tell
from modalmotion.errors import ModalMotionError, NotFoundError, ParameterError
from modalmotion.store.deletion import bury, digest_of_owner
from modalmotion.store.disk import FolderLock, cannot_write, sync_paths
from modalmotion.store.folders import ResultKind
from modalmotion_service.access import audit, scopes
from modalmotion_service.access.keys import KEYS, Key, KeyRing
from modalmotion_service.commands.options import DATA_DIR, folder_with, tell_rows
from modalmotion_service.workspace.owners import FOLDER, folder_of
from modalmotion_service.workspace.spool import sizes

# No owner's name begins so: the service skips folders under removal.
_REMOVED: Final = ".removed-"


def usage_of(data_dir: Path) -> Iterator[dict[str, str | int]]:
    """Measure the usage of each owner, with active keys; a service may have it open.

    Parameters
    ----------
    data_dir : Path
    """
    others = [path for path in sorted((data_dir / FOLDER).glob("[a-z0-9]*")) if path.is_dir()]
    active = [key.owner for key in _keys(data_dir) if key.state == "active"]
    for owner, root in ((scopes.LOCAL, data_dir), *((path.name, path) for path in others)):
        yield {
            "owner": owner,
            "n_sequences": _count(root / "sequences", "*/*.json"),
            "n_results": sum(_count(root / f"{kind}s", "*/*.h5") for kind in get_args(ResultKind)),
            "n_models": _count(root / "models", "*/*.h5"),
            # Of all files: index, templates, and what is under way too.
            "n_bytes": sum(sizes(root)),
            "n_keys": active.count(owner),
        }


def remove_owner(data_dir: Path, owner: str) -> None:
    """Take back an owner's keys and remove everything they have.

    Parameters
    ----------
    data_dir : Path
    owner : str

    Raises
    ------
    ParameterError
        If it is the owner of the data folder itself, or the name is not valid.
    NotFoundError
        If there is nothing of that owner.
    StoreError
        If a service has the store open, or files cannot be removed; call it again then.
    """
    if owner == scopes.LOCAL:
        raise ParameterError(
            f"The store of '{scopes.LOCAL}' is the data folder itself.",
            remedy="Delete its sequences, or remove the whole folder.",
        )
    root = folder_of(data_dir, owner)
    doomed = root.with_name(f"{_REMOVED}{owner}")
    if not root.is_dir() and not doomed.is_dir():
        raise NotFoundError(
            f"There is no owner {owner!r} in {data_dir}.", remedy="See `modalmotion owners list`."
        )
    with audit.AuditLog(data_dir) as log:
        log.append([audit.of_command("owners remove", owner, "", audit.BEGUN)])
        try:
            _remove(data_dir, owner, root, doomed)
        except ModalMotionError:
            log.append([audit.of_command("owners remove", owner, "", 409)])
            raise
        log.append([audit.of_command("owners remove", owner, "")])


def _remove(data_dir: Path, owner: str, root: Path, doomed: Path) -> None:
    try:
        if root.is_dir():
            with FolderLock(root / "lock"):
                for key in _keys(data_dir):
                    if key.owner == owner and key.revoked is None:
                        audit.take_back_key(data_dir, key.id)
                if doomed.is_dir():
                    shutil.rmtree(doomed)
                # From here on it is gone, even if the rest is interrupted.
                root.rename(doomed)
                sync_paths([doomed.parent])
        shutil.rmtree(doomed)
        # Backups learn by it that nothing was lost; a removal that is cut short is done again.
        bury(data_dir, digest_of_owner(owner))
    except OSError as error:
        raise cannot_write(doomed, error) from error


def _keys(data_dir: Path) -> list[Key]:
    if not (data_dir / KEYS).is_file():
        return []
    with KeyRing(data_dir) as ring:
        return ring.all()


def _count(folder: Path, pattern: str) -> int:
    return sum(1 for _ in folder.glob(pattern))


@click.group()
def owners() -> None:
    """List the data of each owner, or remove an owner with all data."""


@owners.command("list", epilog=example("owners list --data-dir results"))
@json_option
@DATA_DIR
def list_owners(as_json: bool, data_dir: Path | None) -> None:
    """List sequences, results, models, megabytes and active keys; a service may be running."""
    usage = list(usage_of(folder_with(data_dir, "", "is no service's data")))
    rows = [{**one, "n_bytes": f"{int(one['n_bytes']) / 1e6:.1f}"}.values() for one in usage]
    head = ("owner", "sequences", "results", "models", "MB", "keys")
    tell_rows(head, map(tuple, rows), usage, as_json=as_json)


@owners.command(epilog=example("owners remove lab"))
@click.argument("owner", metavar="NAME")
@click.option("--yes", is_flag=True, help="Do not ask.")
@json_option
@DATA_DIR
def remove(owner: str, yes: bool, as_json: bool, data_dir: Path | None) -> None:
    """Remove the owner NAME with all sequences, results, models, jobs, and revoke its keys.

    No service may have the folder open. Backups keep what they have until the next one to the
    same folder, and the audit log keeps what was done by whom to which digest of an id.
    """
    folder = folder_with(data_dir, "", "is no service's data")
    if not yes:
        click.confirm(f"Remove everything that {owner} has in {folder.absolute()}?", abort=True)
    remove_owner(folder, owner)
    tell({"removed": owner}, [f"{owner} is removed"], as_json=as_json)
