"""All settings of the service: names, values in force, defaults, meanings."""

import json
import textwrap
from collections.abc import Iterator
from typing import Any

import click

from modalmotion.cli.shared import example, json_option


@click.command("settings", epilog=example("settings --json"))
@json_option
def settings(as_json: bool) -> None:
    """Show every setting: its variable, value, default and meaning."""
    # Here, so that the help of all commands need not import the settings.
    from modalmotion_service.settings import read_settings

    known = list(described(read_settings()))
    click.echo(json.dumps(known, indent=1) if as_json else in_words(known))


def described(settings: Any) -> Iterator[dict[str, Any]]:
    """Describe each setting of a pydantic model of settings, in its order."""
    # Here, so that the help of all commands need not import the models.
    from modalmotion_service.schemas.from_core import strings_of

    kind = type(settings)
    values = settings.model_dump(mode="json")
    words = strings_of(kind.__module__)[kind.__name__]
    defaults = kind.model_construct().model_dump(mode="json")
    for name in kind.model_fields:
        yield {
            "variable": f"{settings.model_config['env_prefix']}{name.upper()}",
            "value": values[name],
            "default": defaults[name],
            "meaning": " ".join(words[name].split()),
        }


def in_words(known: list[dict[str, Any]]) -> str:
    """Lay settings out for a terminal; one that is not at its default shows both."""
    lines: list[str] = []
    for one in known:
        value, default = (json.dumps(one[name]) for name in ("value", "default"))
        shown = value if value == default else f"{value} (default: {default})"
        lines.append(f"{one['variable']} = {shown}")
        lines += textwrap.wrap(one["meaning"], 92, initial_indent="    ", subsequent_indent="    ")
    return "\n".join(lines)
