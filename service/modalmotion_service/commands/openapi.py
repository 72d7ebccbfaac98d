"""Write the OpenAPI document, or check that the committed one is current."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from modalmotion_service.app import create_app
from modalmotion_service.contract.changes import change_between, is_at_least, least_version
from modalmotion_service.settings import Settings


def document() -> str:
    """Give the OpenAPI document as it is committed."""
    return json.dumps(create_app(Settings()).openapi(), indent=2, sort_keys=True) + "\n"


@click.command()
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--check", is_flag=True, help="Compare, write nothing.")
def main(path: Path, check: bool) -> None:
    """Write the OpenAPI document to PATH, or compare it with what lies there."""
    text = document()
    if check:
        if not path.is_file() or path.read_text() != text:
            raise click.ClickException(f"{path} is not what the code says: run `make openapi`.")
        return
    if path.is_file():
        require_version(json.loads(path.read_text()), json.loads(text))
    path.write_text(text)


def require_version(old: dict[str, Any], new: dict[str, Any]) -> None:
    """Check that the version says what has changed.

    Parameters
    ----------
    old, new : dict
        OpenAPI documents: as committed, and as the code has it.

    Raises
    ------
    ClickException
        If it does not: names the least version that does, and the changes.
    """
    change, what = change_between(old, new)
    least = least_version(old["info"]["version"], change)
    version = new["info"]["version"]
    if not is_at_least(version, least):
        listed = "".join(f"\n  {line}" for line in what[:40])
        raise click.ClickException(
            f"The interface changed ({change.name.lower()}); API_VERSION in api_version.py is "
            f"{version} and must be at least {least}.{listed}"
        )


if __name__ == "__main__":
    main()
