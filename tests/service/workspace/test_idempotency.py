"""The table of idempotency keys."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from modalmotion.errors import StoreError
from modalmotion.store import ResultStore
from modalmotion_service.workspace.jobs import IdempotencyKeys


@pytest.fixture
def keys(tmp_path: Path) -> Iterator[IdempotencyKeys]:
    with ResultStore(tmp_path) as store:
        yield IdempotencyKeys(store.database)


def test_a_key_is_claimed_once_and_answers_again_what_was_answered(keys: IdempotencyKeys) -> None:
    assert keys.claim("k", "sent") is None
    under_way = keys.claim("k", "sent")
    assert under_way is not None
    assert (under_way.fingerprint, under_way.status, under_way.response) == ("sent", None, None)
    keys.complete("k", 201, {"id": "a"})
    again = keys.claim("k", "otherwise")
    assert again is not None
    assert (again.fingerprint, again.status, again.response) == ("sent", 201, {"id": "a"})
    assert keys.claim("k", "sent") == again
    keys.release("k")
    assert keys.claim("k", "otherwise") is None


def test_what_clients_chose_is_kept_as_a_digest_and_known_again(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        keys = IdempotencyKeys(store.database)
        keys.claim("Mustermann 1", "sent")
        keys.complete("Mustermann 1", 201, None)
        known = IdempotencyKeys(store.database).claim("Mustermann 1", "sent")
        assert known is not None
        assert known.status == 201
        for path in tmp_path.glob("index.sqlite*"):
            assert b"Mustermann" not in path.read_bytes()
    with ResultStore(tmp_path) as store:
        assert IdempotencyKeys(store.database).claim("Mustermann 1", "sent") is not None


def test_of_many_requests_at_once_one_has_the_key(keys: IdempotencyKeys) -> None:
    with ThreadPoolExecutor(8) as pool:
        claims = list(pool.map(lambda n: keys.claim("k", str(n)), range(32)))
    assert claims.count(None) == 1


def test_keys_of_requests_that_died_and_of_long_ago_are_freed(tmp_path: Path) -> None:
    with ResultStore(tmp_path) as store:
        keys = IdempotencyKeys(store.database)
        keys.claim("dead", "a")
        keys.claim("done", "a")
        keys.complete("done", 200, None)
    with ResultStore(tmp_path) as store:
        keys = IdempotencyKeys(store.database)
        assert keys.release_unfinished() == 1
        assert keys.claim("dead", "a") is None
        assert keys.forget_before("2020") == 0
        assert keys.forget_before("9999") == 2
        assert keys.claim("done", "a") is None


def test_kept_answers_are_replaced_at_and_below_a_place_alone(keys: IdempotencyKeys) -> None:
    places = ("/v1/sequences/ab", "/v1/sequences/ab/classifications", "/v1/sequences/abc", None)
    for number, place in enumerate(places):
        headers = {} if place is None else {"location": place}
        keys.claim(str(number), "request")
        keys.complete(str(number), 201, {"body": "", "headers": headers})
    keys.claim("under way", "request")
    assert keys.replace_answers("/v1/sequences/ab", 404, {"body": "gone"}) == 2
    found = [keys.claim(str(number), "request") for number in range(4)]
    assert [answer and answer.status for answer in found] == [404, 404, 201, 201]


def test_an_answer_that_could_not_be_kept_is_kept_before_its_key_is_claimed_again(
    keys: IdempotencyKeys, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full() -> None:
        raise StoreError("The disk is full.")

    keys.claim("done", "sent")
    keys.claim("undone", "sent")
    with monkeypatch.context() as now:
        now.setattr(keys._database, "write", full)
        with pytest.raises(StoreError):
            keys.complete("done", 202, {})
        with pytest.raises(StoreError):
            keys.release("undone")
        with pytest.raises(StoreError):
            keys.claim("done", "sent")
    again = keys.claim("done", "sent")
    assert again is not None
    assert again.status == 202
    assert keys.claim("undone", "sent") is None


def test_an_answer_that_is_kept_late_states_what_was_changed_before(
    keys: IdempotencyKeys, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full() -> None:
        raise StoreError("The disk is full.")

    keys.claim("late", "sent")
    answer = {"body": '{"subject":"P7","n":1}', "headers": {"location": "/v1/sequences/ab"}}
    with monkeypatch.context() as now:
        now.setattr(keys._database, "write", full)
        with pytest.raises(StoreError):
            keys.complete("late", 201, answer)
    keys.restate({"subject": "P8"}, "/v1/sequences/ab")
    again = keys.claim("late", "sent")
    assert again is not None
    assert again.response["body"] == '{"subject":"P8","n":1}'
