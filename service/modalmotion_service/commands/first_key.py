"""The first key: made when a service that others can reach starts without any."""

from __future__ import annotations

import click

from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.principal import LOCAL
from modalmotion_service.access.scopes import Scope
from modalmotion_service.access.site import is_loopback
from modalmotion_service.audit.key_events import make_key
from modalmotion_service.settings import Settings


def secured(settings: Settings, host: str) -> Settings:
    """Demand keys where the address to listen on can be reached from other machines."""
    if is_loopback(host):
        return settings
    return settings.model_copy(update={"require_keys": True})


def offer_first_key(settings: Settings) -> None:
    """Make and show a key with every scope where keys are needed and none was ever made."""
    if not settings.require_keys:
        return
    with KeyRing(settings.data_dir) as ring:
        if ring.all():
            return
    key, token = make_key(settings.data_dir, LOCAL, frozenset(Scope), note="first key")
    # To standard output, apart from the log, which goes to standard error.
    click.echo(
        "\n  This service needs keys, and there was none. The first one, with every scope;\n"
        "  it is shown this once and kept as a hash only:\n\n"
        f"      {token}\n\n"
        f"  Make others with `modalmotion keys create`; take it back with "
        f"`modalmotion keys revoke {key.id}`.\n"
    )
