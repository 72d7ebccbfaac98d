"""The one table of the scope that each route needs, and who sends a request."""

import re
from dataclasses import dataclass
from difflib import get_close_matches
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

_OF_PATH: Final[dict[str, dict[str, Scope | None]]] = {
    "/health/live": {"GET": OPEN},
    "/health/ready": {"GET": OPEN},
    "/": {"GET": OPEN},
    "/view/{key}": {"GET": OPEN},
    "/images/{images_id}": {"GET": OPEN},
    "/viewer/{name}": {"GET": OPEN},
    "/docs": {"GET": OPEN},
    "/openapi.json": {"GET": OPEN},
    "/metrics": {"GET": Scope.METRICS},
    "/v1/limits": {"GET": Scope.READ},
    "/v1/audit": {"GET": Scope.ADMIN},
    "/v1/sequences": {"POST": Scope.WRITE, "GET": Scope.READ},
    "/v1/sequences/sample": {"POST": Scope.WRITE},
    "/v1/sequences/{sequence_id}": {"GET": Scope.READ, "PATCH": Scope.WRITE, "DELETE": Scope.WRITE},
    # It keeps nothing: a POST only because a body is sent.
    "/v1/sequences/{sequence_id}/tradeoff": {"POST": Scope.READ},
    "/v1/sequences/{sequence_id}/encoded": {"GET": Scope.READ},
    "/v1/sequences/{sequence_id}/signatures": {"POST": Scope.WRITE, "GET": Scope.READ},
    "/v1/sequences/{sequence_id}/signature": {"GET": Scope.READ},
    "/v1/signatures/{key}": {"GET": Scope.READ, "DELETE": Scope.WRITE},
    "/v1/signatures/{key}/readouts": {"GET": Scope.READ},
    "/v1/signatures/{key}/strain": {"GET": Scope.READ},
    "/v1/signatures/{key}/table": {"GET": Scope.READ},
    "/v1/signatures/{key}/reconstruction": {"GET": Scope.READ},
    "/v1/signatures/{key}/report": {"GET": Scope.READ},
    "/v1/signatures/{key}/dicom": {"POST": Scope.READ},
    "/v1/signatures/{key}/view": {"GET": Scope.READ},
    "/v1/signatures/{key}/distance": {"GET": Scope.READ},
    "/v1/signatures/{key}/classifications": {"POST": Scope.WRITE, "GET": Scope.READ},
    # These store the signatures that they make on the way.
    "/v1/signatures/query": {"POST": Scope.WRITE},
    "/v1/features": {"POST": Scope.WRITE},
    # These keep nothing: a POST only because a file is sent.
    "/v1/signature": {"POST": Scope.READ},
    "/v1/classify": {"POST": Scope.READ},
    "/v1/encode": {"POST": Scope.READ},
    "/v1/decode": {"POST": Scope.READ},
    "/v1/images": {"POST": Scope.WRITE, "GET": Scope.READ},
    "/v1/images/{images_id}": {"GET": Scope.READ, "DELETE": Scope.WRITE},
    "/v1/tracks": {"POST": Scope.WRITE},
    "/v1/tracks/{track_id}": {"GET": Scope.READ},
    "/v1/templates": {"POST": Scope.WRITE, "GET": Scope.READ},
    "/v1/templates/{template_id}": {"GET": Scope.READ, "DELETE": Scope.WRITE},
    "/v1/templates/{template_id}/modes": {"GET": Scope.READ},
    "/v1/models": {"GET": Scope.READ, "POST": Scope.TRAIN},
    "/v1/models/{name}": {"GET": Scope.READ, "DELETE": Scope.TRAIN},
    # These store the classifications and signatures that they make on the way.
    "/v1/models/{name}/evaluations": {"POST": Scope.WRITE},
    "/v1/norms/{name}/deviations": {"POST": Scope.WRITE},
    "/v1/norms": {"POST": Scope.TRAIN, "GET": Scope.READ},
    "/v1/norms/{name}": {"GET": Scope.READ, "DELETE": Scope.TRAIN},
    "/v1/jobs": {"GET": Scope.READ},
    "/v1/jobs/{job_id}": {"GET": Scope.READ, "DELETE": Scope.WRITE},
    "/v1/jobs/{job_id}/result": {"GET": Scope.READ},
}
SCOPE_OF: Final = {
    (method, path): scope for path, of in _OF_PATH.items() for method, scope in of.items()
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


# Of two templates that match a path the one with fewer parameters is meant.
_MATCHERS: Final = {
    method: [
        (compile_path(template)[0], template, _OF_PATH[template][method])
        for template in sorted(_OF_PATH, key=lambda path: path.count("{"))
        if method in _OF_PATH[template]
    ]
    for method in ("GET", "POST", "PATCH", "DELETE")
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


def calls_like(path: str) -> list[str]:
    """List the calls whose paths end nearly as one that does not exist."""
    end = path.rstrip("/").rpartition("/")[2]
    ends = {template.rpartition("/")[2] for _, template in SCOPE_OF if "/v1/" in template}
    near = get_close_matches(end, ends)
    return [f"{method} {name}" for method, name in SCOPE_OF if name.rpartition("/")[2] in near]


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
