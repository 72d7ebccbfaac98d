"""What a service that keeps nothing serves: models and templates of a folder that is only read."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from modalmotion.errors import StoreError

_SERVED: Final = ("models", "templates")


def lay_out(source: Path, root: Path) -> None:
    """Have the models and templates of a store in another one, which is new, by links to files.

    Parameters
    ----------
    source : Path
        Folder of an owner's store, or of its backup; may be missing.
    root : Path

    Raises
    ------
    StoreError
        If the folder cannot be read.
    """
    try:
        for name in _SERVED:
            for file in (source / name).rglob("*") if (source / name).is_dir() else ():
                if not file.is_file():
                    continue
                link = root / file.relative_to(source)
                link.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                if not link.is_symlink():
                    link.symlink_to(file.absolute())
    except OSError as error:
        raise StoreError(
            f"Models and templates of '{source.name}' cannot be read: {error.strerror}.",
            remedy="Check the folder that is named as --read-only-dir.",
        ) from error
