"""Who sends a request."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

from starlette.types import Scope as Connection

from modalmotion.errors import ParameterError
from modalmotion_service.access.scopes import Scope

LOCAL: Final = "local"
"""Owner of the store that lies in the data folder itself."""

_OWNER: Final = re.compile(r"[a-z0-9][a-z0-9_-]{0,62}")
_PLACE: Final = "modalmotion.principal"


@dataclass(frozen=True)
class Principal:
    """Who sends a request, and what they may do.

    Parameters
    ----------
    owner : str
        Whose store they see; no other.
    key_id : str or None
        None for a request from this machine that needs no key.
    scopes : frozenset of Scope
    """

    owner: str
    key_id: str | None
    scopes: frozenset[Scope]


LOCAL_PRINCIPAL: Final = Principal(LOCAL, None, frozenset(Scope))


def require_owner(name: str) -> str:
    """Check the name of an owner, which is the name of a folder too.

    Raises
    ------
    ParameterError
        If it is not a valid name.
    """
    if _OWNER.fullmatch(name) is None:
        raise ParameterError(
            f"{name[:80]!r} cannot be the name of an owner.",
            remedy="Use at most 63 small letters, digits, - and _, with a letter or digit first.",
        )
    return name


def attach(connection: Connection, principal: Principal) -> None:
    """Attach the sender of its request to a connection."""
    connection[_PLACE] = principal


def principal_of(connection: Connection) -> Principal | None:
    """Give the sender of a request; None on open routes."""
    principal: Principal | None = connection.get(_PLACE)
    return principal
