from __future__ import annotations

from fastapi.routing import APIRoute

from modalmotion_service.app import judged_routes
from modalmotion_service.http.gate import require_judged


def test_every_route_requires_the_gates_judgement() -> None:
    routes = judged_routes()
    assert len(routes) > 60
    for route in routes:
        assert isinstance(route, APIRoute)
        assert require_judged in [one.dependency for one in route.dependencies], route.path
