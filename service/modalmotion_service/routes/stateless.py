"""Routes of a service that keeps nothing; all others say so."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, NoReturn

from fastapi import Depends
from fastapi.routing import APIRoute
from starlette.routing import BaseRoute, Route

from modalmotion_service.errors import NeedsStoreError
from modalmotion_service.http.gate import require_judged

SERVED: Final = frozenset(
    (
        *(("POST", f"/v1/{name}") for name in ("signature", "classify", "encode", "decode")),
        *(("GET", f"/v1/{name}") for name in ("limits", "models", "templates")),
        ("GET", "/v1/models/{name}"),
        ("GET", "/v1/templates/{template_id}"),
        ("GET", "/v1/templates/{template_id}/modes"),
        *(("GET", f"/health/{name}") for name in ("live", "ready")),
        ("GET", "/metrics"),
    )
)
"""Calls whose answer hangs on nothing that was sent before, by method and template."""


def stateless_routes(routes: Iterable[BaseRoute]) -> list[BaseRoute]:
    """Give routes that serve what needs no store, and refuse the rest by name.

    Parameters
    ----------
    routes : iterable of route
        Of a service with a store.
    """
    return [route if _is_served(route) else _refused(route) for route in routes]


def _is_served(route: BaseRoute) -> bool:
    return isinstance(route, Route) and any(
        (method, route.path) in SERVED for method in route.methods or ()
    )


def _refused(route: BaseRoute) -> APIRoute:
    assert isinstance(route, Route)  # noqa: S101 (all of ours are)
    return APIRoute(
        route.path,
        _refuse,
        response_model=None,
        methods=sorted(route.methods or ()),
        include_in_schema=False,
        dependencies=[Depends(require_judged)],
    )


def _refuse() -> NoReturn:
    raise NeedsStoreError(
        "This service keeps nothing, and the call needs a store.",
        remedy="Send the sequence with POST /v1/signature or POST /v1/classify, which need none, "
        "or ask a service that was started without --stateless.",
    )
