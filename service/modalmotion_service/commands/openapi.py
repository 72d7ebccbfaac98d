"""Write the OpenAPI document, or check that the committed one is current."""

import json
from pathlib import Path

import click

from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings


def document() -> str:
    """Give the OpenAPI document as it is committed."""
    return json.dumps(create_app(Settings()).openapi(), indent=2, sort_keys=True) + "\n"


@click.command()
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--check", is_flag=True, help="Compare, write nothing.")
def main(path: Path, check: bool) -> None:
    """Write the OpenAPI document to PATH, or compare it with what is there."""
    text = document()
    if check:
        if not path.is_file() or path.read_text() != text:
            raise click.ClickException(f"{path} does not match the code: run `make openapi`.")
        return
    path.write_text(text)


if __name__ == "__main__":
    main()
