"""The client before a service that means ill, and its key in careless hands."""

from __future__ import annotations

import gzip
import io
import itertools
import json
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest
from flaky import Fault, FlakyWay
from running import RunningService

from modalmotion.client import BrokenAnswerError, Client, RemoteError, Retries, UnreachableError
from modalmotion.client.connection import retry_after, segment
from modalmotion.errors import ModalMotionError, ParameterError
from modalmotion.formats import read_npz
from modalmotion.signature.making import modal_signature

KEY = "mm_0123456789abcdef_secret"
TWICE = Retries(attempts=2, first_wait=0.0, longest_wait=0.0)

Handler = Callable[[httpx2.Request], httpx2.Response]


def client_of(handler: Handler, **options: Any) -> Client:
    chosen = {"key": KEY, "retries": TWICE, **options}
    return Client("http://service.test/base", transport=httpx2.MockTransport(handler), **chosen)


def always(content: Any, status: int = 200, **headers: str) -> Handler:
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    kind = {"Content-Type": "application/json", **named}
    return lambda request: httpx2.Response(status, content=content, headers=kind)


def job(**members: object) -> bytes:
    known = {"id": "a" * 32, "kind": "signature", "state": "succeeded", "progress": 1.0}
    return json.dumps({**known, "result": None, "error": None, **members}).encode()


def archive(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


NPY = io.BytesIO()
np.save(NPY, np.zeros(3))
DAMAGED = bytearray(archive(ids=np.array(["a"] * 99), labels=np.array([""] * 99)))
DAMAGED[60:90] = b"\xff" * 30


@pytest.mark.parametrize(
    ("content", "call"),
    [
        (b"[" * 200_000, Client.limits),
        (b"9" * 5000, Client.limits),
        (b"[]", lambda client: client.signatures(["a", "b"])),
        (b"PK\x03\x04" + b"x" * 100, lambda client: client.signatures(["a"])),
        (bytes(DAMAGED), lambda client: client.signatures(["a"])),
        (NPY.getvalue(), lambda client: client.signatures(["a"])),
        (b"\x80\x04cos\nsystem\n.", lambda client: client.signatures(["a"])),
        (archive(ids=np.array(["a"])), lambda client: client.signatures(["a"])),
        (job(error="no"), lambda client: client.job("a")),
        (job(error=5), lambda client: client.job("a")),
        (job(progress=[]), lambda client: client.job("a")),
        (job(result=5), lambda client: client.job("a").wait()),
        (b"[]", lambda client: client.job("a")),
        (b"5", lambda client: client.classify("a")),
        (b'{"classifications": 5}', lambda client: list(client.classifications("a"))),
        (b'{"sequences": [5], "cursor": null}', lambda client: list(client.sequences())),
        (b'{"jobs": 5, "cursor": null}', lambda client: list(client.jobs())),
        # The same page again and again would be a list without an end.
        (b'{"jobs": [], "cursor": "x"}', lambda client: list(client.jobs())),
        (b'{"distance": "far"}', lambda client: client.distance("a", "b")),
    ],
)
def test_an_answer_of_any_form_is_an_error_of_ours(
    content: bytes, call: Callable[[Client], object]
) -> None:
    with client_of(always(content)) as client, pytest.raises(BrokenAnswerError) as broken:
        call(client)
    assert broken.value.remedy


def test_the_class_that_a_job_made_is_of_the_model_that_was_asked() -> None:
    def handler(request: httpx2.Request) -> httpx2.Response:
        sent.append(request.method)
        if request.method == "GET":
            done = request.url.path.endswith("/result")
            known = job(result="/v1/jobs/c/result", progress=1.0)
            return always(b'{"model": "mine"}' if done else known)(request)
        return always(job(state="running"), 202)(request)

    sent: list[str] = []
    with client_of(handler) as client:
        assert client.classify("b", model="mine").model == "mine"
    assert sent.count("POST") == 1


@pytest.mark.parametrize("status", ["x", None, [], 1e308])
def test_the_problem_of_a_job_may_lack_a_status(status: object) -> None:
    handler = always(job(state="failed", error={"detail": "no", "status": status}))
    with client_of(handler) as client, pytest.raises(RemoteError, match="no") as failed:
        client.job("a").wait()
    assert failed.value.status == 500


@pytest.mark.parametrize("asked", [b"-5.0", b"NaN", b"1e308", b'"x"'])
def test_only_the_header_says_how_long_to_wait(asked: bytes) -> None:
    waits: list[float] = []
    handler = always(b'{"code": "busy", "retry_after": ' + asked + b"}", 429)
    with client_of(handler, sleep=waits.append) as client, pytest.raises(RemoteError):
        client.limits()
    assert waits == [0.0]


def test_a_retry_after_that_is_no_time_is_not_understood() -> None:
    for header in ("²", "-5", "1e3", "Fri, 31 Feb 2000", "x", "9" * 400):
        assert retry_after(header) is None, header


def test_deep_json_in_a_problem_is_no_problem() -> None:
    with client_of(always(b"[" * 200_000, 400)) as client, pytest.raises(RemoteError) as error:
        client.limits()
    assert error.value.status == 400


@pytest.mark.parametrize("status", [200, 500])
def test_an_answer_without_an_end_is_left(status: int) -> None:
    taken = 0

    def endless() -> Iterator[bytes]:
        nonlocal taken
        for _ in itertools.repeat(None, 10_000):
            taken += 1
            yield b"x" * 1000

    with (
        client_of(always(endless(), status), most_bytes=50_000) as client,
        pytest.raises(BrokenAnswerError) as broken,
    ):
        client.limits()
    assert (broken.value.limit, broken.value.details["most"]) == ("most_bytes", 50_000)
    assert taken < 1000


def test_an_answer_is_measured_as_it_is_unpacked() -> None:
    bomb = gzip.compress(bytes(20_000_000))
    handler = always(bomb, Content_Encoding="gzip")
    with (
        client_of(handler, most_bytes=1_000_000) as client,
        pytest.raises(BrokenAnswerError, match="longer than 1000000"),
    ):
        client.limits()


def test_an_answer_of_the_most_bytes_is_read() -> None:
    content = json.dumps({"a": "x" * 1000}).encode()
    with client_of(always(content), most_bytes=len(content)) as client:
        assert client.request("GET", "/v1/limits").json == {"a": "x" * 1000}


def test_the_key_goes_to_no_other_host() -> None:
    """Neither by what a caller passes on as a path, nor by a link or a redirection."""
    asked: list[httpx2.Request] = []
    answers = itertools.cycle(
        [httpx2.Response(307, headers={"Location": "http://evil.test/v1/limits"})]
    )

    def note(request: httpx2.Request) -> httpx2.Response:
        asked.append(request)
        return next(answers)

    with client_of(note) as client:
        for path in ("http://evil.test/x", "evil.test", "", "\\\\evil.test/x"):
            with pytest.raises(ParameterError, match="not a path"):
                client.request("GET", path)
        assert not asked
        for path in ("//evil.test/x", "/http://evil.test/x", "/\\evil.test/x", "/@evil.test/x"):
            with pytest.raises(RemoteError):
                client.request("GET", path)
        with pytest.raises(RemoteError):
            client.limits()
        answers = itertools.cycle([httpx2.Response(200, content=job(result="//evil.test/x"))])
        client.job("a").wait()
    assert len(asked) == 7
    assert {request.url.host for request in asked} == {"service.test"}
    assert all(request.url.path.startswith("/base/") for request in asked)


@pytest.mark.parametrize(
    "key", [f"{KEY}\r\nX-Other: y", f"{KEY} {KEY}", f"{KEY}é", f"{KEY}\x00", "", " "]
)
def test_what_is_no_key_is_refused_and_not_repeated(key: str) -> None:
    with pytest.raises(ParameterError) as refused:
        client_of(always(b"{}"), key=key)
    text = "".join(traceback.format_exception(refused.value))
    assert KEY not in text


def test_a_key_may_end_with_the_line_that_it_was_read_from() -> None:
    """Sent with it, it stood in the error: 'Illegal header value b'Bearer mm_...\\n''."""
    sent: list[str] = []

    def note(request: httpx2.Request) -> httpx2.Response:
        sent.append(request.headers["authorization"])
        return httpx2.Response(200, content=b"{}")

    with client_of(note, key=f"{KEY}\n") as client:
        client.limits()
    assert sent == [f"Bearer {KEY}"]


@pytest.mark.parametrize(
    "name", ["../models/m/versions/1", "..", ".", "", "a/signature", "a?b=c", "a#b", "a%2fb", "a\n"]
)
def test_an_id_leads_to_nothing_else(name: str) -> None:
    """`delete("../models/m/versions/1")` deleted a model."""
    asked: list[httpx2.Request] = []

    def note(request: httpx2.Request) -> httpx2.Response:
        asked.append(request)
        return httpx2.Response(204)

    with client_of(note) as client:
        for call in (
            client.delete,
            client.sequence,
            client.signature,
            client.template,
            client.encoded,
            client.reconstruction,
            client.classify,
            client.classifications,
            client.job,
        ):
            with pytest.raises(ParameterError, match="cannot be an id"):
                call(name)
    assert not asked


def test_ids_of_the_service_are_ids() -> None:
    for name in ("0" * 64, "ab" * 16, "nonsense"):
        assert segment(name) == name


def test_a_service_that_names_its_job_oddly_is_not_followed() -> None:
    asked: list[str] = []

    def note(request: httpx2.Request) -> httpx2.Response:
        asked.append(request.url.path)
        return httpx2.Response(200, content=job(id="../sequences", state="running"))

    with client_of(note) as client, pytest.raises(ModalMotionError):
        client.job("a").cancel()
    assert asked == ["/base/v1/jobs/a"]


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
