"""How many requests a minute, and the headers that say so."""

from __future__ import annotations

from pathlib import Path

import pytest
from access_parts import guarded
from fastapi.testclient import TestClient

from modalmotion_service.access.rates import Rates
from modalmotion_service.access.scopes import Scope
from modalmotion_service.app import create_app
from modalmotion_service.errors import RateLimitedError
from modalmotion_service.settings import Settings


def test_a_key_has_so_many_requests_a_minute_whatever_the_others_do(tmp_path: Path) -> None:
    with guarded(tmp_path, max_requests_per_minute=3) as service:
        left = []
        for _ in range(3):
            answer = service.ask("a", "GET", "/v1/limits")
            assert answer.headers["ratelimit-limit"] == "3"
            left.append(answer.headers["ratelimit-remaining"])
        assert left == ["2", "1", "0"]
        answer = service.ask("a", "GET", "/v1/limits")
        problem = answer.json()
        assert (answer.status_code, problem["code"]) == (429, "rate_limited")
        assert (problem["limit"], problem["most"]) == ("requests_per_minute", 3)
        assert 1 <= int(answer.headers["retry-after"]) <= 60
        assert str(problem["retry_after_seconds"]) == answer.headers["retry-after"]
        # A scope that is lacking, and a request in vain, count as well; another key does not.
        assert service.ask("a", "GET", "/v1/limits", Scope.READ).status_code == 200
        assert service.ask("b", "GET", "/v1/limits").status_code == 200


def test_wrong_keys_are_slowed_down_and_right_ones_are_not(tmp_path: Path) -> None:
    with guarded(tmp_path, max_failures_per_minute=4) as service:
        wrong = {"Authorization": "Bearer wrong"}
        statuses = [service.client.get("/v1/limits", headers=wrong).status_code for _ in range(6)]
        assert statuses == [401] * 4 + [429] * 2
        assert service.client.get("/v1/limits").json()["limit"] == "failures_per_minute"
        assert service.ask("a", "GET", "/v1/limits").status_code == 200


def test_strangers_may_look_at_what_is_open_so_often(tmp_path: Path) -> None:
    app = create_app(Settings(data_dir=tmp_path, workers=1, max_anonymous_per_minute=2))
    with TestClient(app, base_url="http://192.0.2.7") as client:
        statuses = [client.get("/docs").status_code for _ in range(3)]
        assert statuses == [200, 200, 429]
        assert client.get("/openapi.json").status_code == 429
        for path in ("/health/live", "/health/ready"):
            assert client.get(path).status_code == 200


def test_this_machine_without_keys_is_not_counted(tmp_path: Path) -> None:
    limits = {"max_requests_per_minute": 1, "max_anonymous_per_minute": 1}
    with guarded(tmp_path, require_keys=False, **limits) as service:
        for _ in range(3):
            answer = service.client.get("/v1/limits")
            assert answer.status_code == 200
            assert "ratelimit-limit" not in answer.headers
        assert answer.json()["requests_per_minute"] == 1


def test_the_window_moves() -> None:
    """Against a list of all times, counted anew for each request."""
    clock, let_through = 0.0, list[float]()
    rates = Rates(5, 1, 1, now=lambda: clock)
    for step in (0, 10, 10, 10, 10, 10, 9, 1, 0, 1, 30, 61, 0, 0, 0, 0, 0, 60):
        clock += step
        within = [time for time in let_through if time > clock - 60]
        if len(within) < 5:
            let_through.append(clock)
            allowed = rates.key("a")
            assert int(allowed["RateLimit-Remaining"]) == 4 - len(within)
            assert int(allowed["RateLimit-Reset"]) == [*within, clock][0] + 60 - clock
        else:
            with pytest.raises(RateLimitedError) as refused:
                rates.key("a")
            assert refused.value.details["retry_after_seconds"] == within[0] + 60 - clock


def test_strangers_are_forgotten_after_a_minute() -> None:
    """They were kept for good, and all looked at with each request: 30 ms for 30,000 of them."""
    clock = 0.0
    rates = Rates(9, 9, 9, now=lambda: clock)
    for number in range(3000):
        rates.failure(f"192.0.{number // 256}.{number % 256}")
        rates.address(f"2001:db8:0:{number:x}::1")
    assert len(rates) == 6000
    clock = 59.0
    rates.key("a")
    assert len(rates) == 6001
    clock = 61.0
    rates.key("a")
    assert len(rates) == 1


def test_a_network_of_ipv6_is_one_client() -> None:
    rates = Rates(9, 2, 2)
    rates.failure("2001:db8::1")
    rates.failure("2001:db8::ffff:2")
    with pytest.raises(RateLimitedError):
        rates.failure("2001:db8::3")
    rates.failure("2001:db8:0:1::1")
    rates.address("2001:db8::3")
    for address in ("192.0.2.1", "192.0.2.2", "192.0.2.3", "unknown"):
        rates.failure(address)
