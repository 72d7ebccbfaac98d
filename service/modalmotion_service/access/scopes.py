"""The one table of the scope that each route needs, and who sends a request."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from starlette.routing import compile_path
from starlette.types import Scope as Connection

from modalmotion.errors import ParameterError


class Scope(StrEnum):
    """Rights of a key; none of them includes another."""

    READ = "read"
    WRITE = "write"
    TRAIN = "train"
    ADMIN = "admin"
    METRICS = "metrics"


OPEN: Final = None
"""The scope of routes open to everybody: they tell nothing of anybody's data."""

PROBES: Final = ("/health/",)
"""Paths of health probes, which come every few seconds and must always be answered."""

SCOPE_OF: Final[dict[tuple[str, str], Scope | None]] = {
    ("GET", "/health/live"): OPEN,
    ("GET", "/health/ready"): OPEN,
    ("GET", "/"): OPEN,
    ("GET", "/view/{key}"): OPEN,
    ("GET", "/images/{images_id}"): OPEN,
    ("GET", "/viewer/{name}"): OPEN,
    ("GET", "/docs"): OPEN,
    ("GET", "/openapi.json"): OPEN,
    ("GET", "/metrics"): Scope.METRICS,
    ("GET", "/v1/limits"): Scope.READ,
    ("GET", "/v1/audit"): Scope.ADMIN,
    ("POST", "/v1/sequences"): Scope.WRITE,
    ("POST", "/v1/sequences/sample"): Scope.WRITE,
    ("GET", "/v1/sequences"): Scope.READ,
    ("GET", "/v1/sequences/{sequence_id}"): Scope.READ,
    ("PATCH", "/v1/sequences/{sequence_id}"): Scope.WRITE,
    ("DELETE", "/v1/sequences/{sequence_id}"): Scope.WRITE,
    # It keeps nothing: a POST only because a body is sent.
    ("POST", "/v1/sequences/{sequence_id}/tradeoff"): Scope.READ,
    ("GET", "/v1/sequences/{sequence_id}/encoded"): Scope.READ,
    ("POST", "/v1/sequences/{sequence_id}/signatures"): Scope.WRITE,
    ("GET", "/v1/sequences/{sequence_id}/signatures"): Scope.READ,
    ("GET", "/v1/sequences/{sequence_id}/signature"): Scope.READ,
    ("GET", "/v1/signatures/{key}"): Scope.READ,
    ("DELETE", "/v1/signatures/{key}"): Scope.WRITE,
    ("GET", "/v1/signatures/{key}/readouts"): Scope.READ,
    ("GET", "/v1/signatures/{key}/strain"): Scope.READ,
    ("GET", "/v1/signatures/{key}/table"): Scope.READ,
    ("GET", "/v1/signatures/{key}/reconstruction"): Scope.READ,
    ("GET", "/v1/signatures/{key}/report"): Scope.READ,
    ("POST", "/v1/signatures/{key}/dicom"): Scope.READ,
    ("GET", "/v1/signatures/{key}/view"): Scope.READ,
    ("GET", "/v1/signatures/{key}/distance"): Scope.READ,
    ("POST", "/v1/signatures/{key}/classifications"): Scope.WRITE,
    ("GET", "/v1/signatures/{key}/classifications"): Scope.READ,
    # These store the signatures that they make on the way.
    ("POST", "/v1/signatures/query"): Scope.WRITE,
    ("POST", "/v1/features"): Scope.WRITE,
    # These keep nothing: a POST only because a file is sent.
    ("POST", "/v1/signature"): Scope.READ,
    ("POST", "/v1/classify"): Scope.READ,
    ("POST", "/v1/encode"): Scope.READ,
    ("POST", "/v1/decode"): Scope.READ,
    ("POST", "/v1/images"): Scope.WRITE,
    ("GET", "/v1/images"): Scope.READ,
    ("GET", "/v1/images/{images_id}"): Scope.READ,
    ("DELETE", "/v1/images/{images_id}"): Scope.WRITE,
    ("POST", "/v1/tracks"): Scope.WRITE,
    ("GET", "/v1/tracks/{track_id}"): Scope.READ,
    ("POST", "/v1/templates"): Scope.WRITE,
    ("GET", "/v1/templates"): Scope.READ,
    ("GET", "/v1/templates/{template_id}"): Scope.READ,
    ("GET", "/v1/templates/{template_id}/modes"): Scope.READ,
    ("DELETE", "/v1/templates/{template_id}"): Scope.WRITE,
    ("GET", "/v1/models"): Scope.READ,
    ("POST", "/v1/models"): Scope.TRAIN,
    ("GET", "/v1/models/{name}"): Scope.READ,
    ("DELETE", "/v1/models/{name}"): Scope.TRAIN,
    # These store the classifications and signatures that they make on the way.
    ("POST", "/v1/models/{name}/evaluations"): Scope.WRITE,
    ("POST", "/v1/norms/{name}/deviations"): Scope.WRITE,
    ("POST", "/v1/norms"): Scope.TRAIN,
    ("GET", "/v1/norms"): Scope.READ,
    ("GET", "/v1/norms/{name}"): Scope.READ,
    ("DELETE", "/v1/norms/{name}"): Scope.TRAIN,
    ("GET", "/v1/jobs"): Scope.READ,
    ("GET", "/v1/jobs/{job_id}"): Scope.READ,
    ("GET", "/v1/jobs/{job_id}/result"): Scope.READ,
    ("DELETE", "/v1/jobs/{job_id}"): Scope.WRITE,
}
"""By method and by the route's template. A route that is not here is refused to everybody."""


@dataclass(frozen=True)
class Target:
    """Route that a request addresses.

    Parameters
    ----------
    template : str
        Of the route's path.
    scope : Scope or None
        That it needs; None if it is open to everybody.
    path_parameters : dict
        As they are in the path, unchecked.
    """

    template: str
    scope: Scope | None
    path_parameters: dict[str, str]


_BY_METHOD: Final[dict[str, list[tuple[str, Scope | None]]]] = {}
for (_method, _template), _scope in SCOPE_OF.items():
    _BY_METHOD.setdefault(_method, []).append((_template, _scope))
# Of two templates that match a path the one with fewer parameters is meant.
_MATCHERS: Final = {
    method: [
        (compile_path(template)[0], template, scope)
        for template, scope in sorted(routes, key=lambda route: route[0].count("{"))
    ]
    for method, routes in _BY_METHOD.items()
}


def target_of(method: str, path: str) -> Target | None:
    """Find the route that a request addresses; None if there is none."""
    for pattern, template, scope in _MATCHERS.get("GET" if method == "HEAD" else method, ()):
        if match := pattern.match(path):
            return Target(template, scope, match.groupdict())
    return None


def methods_of(path: str) -> list[str]:
    """List the methods that a path knows, sorted.

    A path that is in the interface's document as it is has the methods of that entry alone.
    """
    if literal := {method for method, template in SCOPE_OF if template == path}:
        found = literal
    else:
        found = {method for method in _MATCHERS if target_of(method, path) is not None}
    return sorted(found | ({"HEAD"} if "GET" in found else set()))


LOCAL: Final = "local"
"""Owner of the store that is in the data folder itself."""

_OWNER: Final = re.compile(r"[a-z0-9][a-z0-9_-]{0,62}")
_SENDER: Final = "modalmotion.principal"


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
    connection[_SENDER] = principal


def principal_of(connection: Connection) -> Principal | None:
    """Give the sender of a request; None on open routes."""
    principal: Principal | None = connection.get(_SENDER)
    return principal
