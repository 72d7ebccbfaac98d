from __future__ import annotations

from fastapi.routing import APIRoute

from modalmotion_service.app import gated_routes
from modalmotion_service.http.gate import require_gate


def test_every_route_requires_the_check_of_the_gate() -> None:
    routes = gated_routes()
    assert len(routes) > 60
    for route in routes:
        assert isinstance(route, APIRoute)
        assert require_gate in [one.dependency for one in route.dependencies], route.path
