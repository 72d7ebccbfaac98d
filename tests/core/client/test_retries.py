"""The client on a way that fails: everything arrives once, nothing hangs."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from flaky import Fault, FlakyWay
from running import RunningService

from modalmotion.client import Client, RemoteError, Retries, UnreachableError
from modalmotion.formats import read_npz
from modalmotion.signature.making import modal_signature

PASSING = [fault for fault in Fault if fault not in (Fault.NONE, Fault.DRIP)]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    running = RunningService(tmp_path_factory.mktemp("service") / "results", {"WORKERS": "1"})
    yield running.start()
    running.stop()


@pytest.fixture
def way(service: RunningService) -> Iterator[FlakyWay]:
    with FlakyWay(service.port) as way:
        yield way


class Sleeps:
    """Takes the place of time.sleep, and notes for how long."""

    def __init__(self) -> None:
        self.asked: list[float] = []

    def __call__(self, seconds: float) -> None:
        self.asked.append(seconds)
        time.sleep(min(seconds, 0.05))


def client_on(way: FlakyWay, sleep: Sleeps, timeout: float = 1.0, **retries: float) -> Client:
    chosen = Retries(rng=np.random.default_rng(1), **retries)  # type: ignore[arg-type]
    return Client(way.base, timeout=timeout, retries=chosen, sleep=sleep)


@pytest.mark.every(2)
@pytest.mark.parametrize("fault", PASSING, ids=lambda fault: fault.name)
def test_an_upload_arrives_exactly_once_whatever_happens_on_the_way(
    service: RunningService, way: FlakyWay, beat: bytes, fault: Fault
) -> None:
    sequence = read_npz(beat).sequence
    way.faults.extend([fault, fault])
    with Client(service.base) as direct:
        before = {job.id for job in direct.jobs()}
        with client_on(way, Sleeps()) as client:
            # A job each time it arrives: more than the content's id could hide.
            started = client.start_upload(sequence)
            assert started.wait(timeout=30).id == sequence.id
            assert {job.id for job in direct.jobs()} - before == {started.id}
            assert way.n_requests >= 4
            way.faults.append(fault)
            assert np.array_equal(
                client.signature(sequence.id).amplitudes, modal_signature(sequence).amplitudes
            )
        direct.delete(sequence.id)


@pytest.mark.parametrize("fault", [Fault.LOSE_ANSWER, Fault.TRUNCATE], ids=lambda f: f.name)
def test_a_lost_answer_is_given_again_and_not_made_again(
    service: RunningService, way: FlakyWay, beat: bytes, fault: Fault
) -> None:
    way.faults.append(fault)
    with client_on(way, Sleeps()) as client:
        info = client.upload(beat)
        assert info.reading.format == "npz"
        way.faults.append(fault)
        # Deleted by the attempt whose answer was lost; that is no error.
        client.delete(info.id)
        assert info.id not in [one.id for one in client.sequences()]


def test_many_faults_in_a_row_are_given_up_on_and_named(way: FlakyWay) -> None:
    sleeps = Sleeps()
    way.faults.extend([Fault.REFUSE] * 10)
    with client_on(way, sleeps, attempts=4) as client, pytest.raises(UnreachableError) as caught:
        client.limits()
    assert caught.value.code == "unreachable"
    assert caught.value.remedy
    assert way.n_requests == 4
    # Doubled each time, and half of it at random.
    assert all(
        0.5 * wait <= asked <= wait
        for asked, wait in zip(sleeps.asked, [0.2, 0.4, 0.8], strict=True)
    )


def test_the_service_says_how_long_to_wait(way: FlakyWay) -> None:
    sleeps = Sleeps()
    way.faults.extend([Fault.BUSY, Fault.UNAVAILABLE])
    with client_on(way, sleeps) as client:
        assert client.limits()
    assert 2.0 <= sleeps.asked[0] < 2.1
    assert sleeps.asked[1] < 0.5


def test_a_wait_beyond_the_deadline_is_not_begun(way: FlakyWay) -> None:
    sleeps = Sleeps()
    way.faults.extend([Fault.BUSY] * 5)
    with client_on(way, sleeps, deadline=1.0) as client, pytest.raises(RemoteError) as caught:
        client.limits()
    assert caught.value.status == 429
    assert sleeps.asked == []


def test_an_answer_that_drips_for_ever_ends_at_the_deadline(
    way: FlakyWay, service: RunningService, beat: bytes
) -> None:
    with Client(service.base) as direct:
        sequence_id = direct.upload(beat).id
    way.faults.extend([Fault.DRIP] * 5)
    began = time.monotonic()
    with client_on(way, Sleeps(), deadline=1.5) as client, pytest.raises(UnreachableError):
        # Some 20,000 bytes, 2 ms each: no pause is as long as the timeout.
        client.signature(sequence_id)
    assert time.monotonic() - began < 15


def test_a_service_that_says_nothing_is_left_after_the_timeout(way: FlakyWay) -> None:
    way.faults.extend([Fault.STALL] * 3)
    client = client_on(way, Sleeps(), timeout=0.3, attempts=2)
    with client, pytest.raises(UnreachableError) as caught:
        client.limits()
    assert "timeout" in caught.value.message


def test_what_may_not_be_repeated_is_sent_once(way: FlakyWay) -> None:
    way.faults.append(Fault.LOSE_ANSWER)
    with client_on(way, Sleeps()) as client, pytest.raises(UnreachableError):
        client.request("POST", "/v1/signatures/query", json={"ids": []})
    assert way.n_requests == 1


def test_nobody_there_is_said_after_the_attempts(tmp_path: Path) -> None:
    with FlakyWay(0) as way:
        address = way.base
    sleeps = Sleeps()
    with Client(address, retries=Retries(attempts=3), sleep=sleeps) as client:
        assert not client.is_ready()
        with pytest.raises(UnreachableError, match="cannot connect"):
            client.upload(b"anything")
    assert len(sleeps.asked) == 4


def test_an_answer_in_other_words_is_an_error_of_the_library(way: FlakyWay) -> None:
    way.faults.extend([Fault.NONSENSE] * 2)
    with client_on(way, Sleeps(), attempts=2) as client, pytest.raises(RemoteError) as caught:
        client.limits()
    assert (caught.value.status, caught.value.code) == (502, "remote_error")


@pytest.mark.soak
def test_every_row_of_three_faults(service: RunningService, way: FlakyWay, beat: bytes) -> None:
    sequence = read_npz(beat).sequence
    n_rows = 0
    # More than the faults of a row, for a machine that is slow by itself.
    with Client(service.base) as direct, client_on(way, Sleeps(), attempts=9) as client:
        for row in itertools.product(PASSING, repeat=3):
            before = {job.id for job in direct.jobs(page=1000)}
            way.faults.extend(row)
            job = client.start_upload(sequence)
            assert job.wait(timeout=60).id == sequence.id
            assert {found.id for found in direct.jobs(page=1000)} - before == {job.id}, row
            way.faults.clear()
            n_rows += 1
    print(f"{n_rows} rows of three faults: each upload arrived once")  # noqa: T201
