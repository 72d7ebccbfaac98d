"""The client against a running service: what comes back is the library's own."""

from __future__ import annotations

import io
import pickle
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reachable_values import reachable_values
from running import RunningService

import modalmotion as mm
from modalmotion.client import (
    BrokenAnswerError,
    Client,
    JobCancelledError,
    JobUnfinishedError,
    RemoteError,
    Retries,
)
from modalmotion.client.connection import body_of, retry_after
from modalmotion.client.errors import error_of_answer, remote_error
from modalmotion.formats import read_npz, write_npz
from modalmotion.progress import Progress
from modalmotion.representation import LONGEST_LINE
from modalmotion.signature.distance import compare


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    settings = {"WORKERS": "1", "MAX_QUERY_IDS": "2", "MAX_BODY_BYTES": "5000000"}
    running = RunningService(tmp_path_factory.mktemp("service") / "results", settings)
    yield running.start()
    running.stop()


@pytest.fixture
def remote(service: RunningService) -> Iterator[Client]:
    with Client(service.base, retries=Retries(attempts=1)) as client:
        yield client


@pytest.fixture(scope="module")
def sequence(beat: bytes) -> mm.MeshSequence:
    return read_npz(beat).sequence


def small(seed: int, n_frames: int = 3) -> mm.MeshSequence:
    vertices = np.random.default_rng(seed).normal(size=(n_frames, 64, 3))
    return mm.mesh_sequence(vertices, grid=(8, 8), topology="cup", unit="mm")


def test_a_file_its_bytes_and_the_sequence_are_the_same_upload(
    remote: Client, sequence: mm.MeshSequence, beat: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "beat.npz"
    path.write_bytes(beat)
    assert remote.upload(sequence, subject="one").subject == "one"
    for source in (path, str(path), beat, sequence):
        info = remote.upload(source)
        assert info.id == sequence.id
        assert (info.n_frames, info.n_vertices, info.unit) == (*sequence.vertices.shape[:2], "mm")


def test_strain_is_that_of_the_library(remote: Client, sequence: mm.MeshSequence) -> None:
    found = remote.readouts(remote.upload(sequence).id)
    own = mm.strain(mm.modal_signature(sequence), sequence)
    figures = {one.name: one for one in found.strain.figures}
    assert list(figures) == list(own.names)
    for k, name in enumerate(own.names):
        one = figures[name]
        for said, ours in ((one.end_systolic, own.end_systolic), (one.peak, own.peak)):
            assert (said.value, said.low, said.high) == pytest.approx(tuple(ours[name]))
        assert one.curve == pytest.approx(own.curves[:, k])
        assert one.deviations == pytest.approx(own.deviations[:, k])
    assert (found.strain.dyssynchrony is None) == (own.dyssynchrony is None)


def test_answers_are_one_line(remote: Client, sequence: mm.MeshSequence) -> None:
    sent = remote.upload(sequence)
    job = remote.start_signature(sent.id, modes=7)
    answers = [
        sent,
        job,
        job.wait(),
        remote.make_template(sequence),
        remote.classify(sent.id),
        remote.readouts(sent.id),
        remote.encoded(sent.id, max_error=1.0),
        *remote.signatures([sent.id], modes=7),
        *remote.models(),
        Retries(),
    ]
    kinds = set()
    for value in reachable_values(answers):
        assert len(repr(value)) <= LONGEST_LINE
        assert "\n" not in repr(value)
        kinds.add(type(value).__name__)
    assert {"Info", "Job", "ModalSignature"} <= kinds


def test_progress_runs_to_the_end_and_the_pieces_are_small(
    remote: Client,
) -> None:
    sequence = mm.simulate_ventricle(rng=np.random.default_rng(7))
    file = write_npz(sequence)
    for source, n_bytes in ((file, len(file)), (sequence, sequence.vertices.nbytes)):
        steps: list[Progress] = []
        remote.upload(source, progress=steps.append)
        assert [step.done for step in steps] == sorted(step.done for step in steps)
        assert steps[-1].done == steps[-1].total >= n_bytes
        body = body_of(source)
        pieces = [len(piece) for piece in body.sent(None)]
        assert max(pieces) < 300_000 < sum(pieces)
        # Sent again it is the same request: an idempotency key holds it to that.
        assert b"".join(body.sent(None)) == b"".join(body.sent(None))


@pytest.mark.parametrize("n_frames", [1, 3])
def test_what_is_streamed_as_npz_reads_back_as_it_was(n_frames: int) -> None:
    original = small(5, n_frames)
    read = read_npz(b"".join(body_of(original).sent(None))).sequence
    assert read.id == original.id
    with np.load(io.BytesIO(b"".join(body_of(original).sent(None)))) as archive:
        assert np.array_equal(archive["vertices"], original.vertices)


def test_signatures_are_the_librarys_own_bit_for_bit(
    remote: Client, sequence: mm.MeshSequence
) -> None:
    own = mm.modal_signature(sequence, mm.SignatureParameters(modes=9))
    kept = remote.signature(remote.upload(sequence).id, modes=9)
    for found in (kept, remote.signature_of(sequence, modes=9)):
        assert np.array_equal(found.amplitudes, own.amplitudes)
        assert np.array_equal(found.rotations.matrices, own.rotations.matrices)
        assert (found.modes, found.parameters, found.notes) == (
            own.modes,
            own.parameters,
            own.notes,
        )


def test_raw_numbers_with_a_known_template_leave_nothing_behind(
    remote: Client, sequence: mm.MeshSequence, tmp_path: Path
) -> None:
    raw = sequence.vertices.astype("<f4").tobytes()
    reading: dict[str, Any] = {"format": "raw", "grid": sequence.grid, "topology": "cup"}
    reading["unit"] = "mm"
    template = remote.make_template(raw, **reading)
    assert remote.template(template.id) == template
    modes = remote.template_modes(template.id, 4)
    assert modes.modes[-1] == "(0, 1, sin)"
    assert (modes.shapes**2).mean(axis=0) == pytest.approx(1.0)
    assert modes.shapes.shape == (sequence.n_vertices, len(modes.angular_frequencies))
    remote.save("modes", tmp_path / "modes.png", template.id, modes=4)
    assert (tmp_path / "modes.png").read_bytes().startswith(b"\x89PNG")
    narrow = mm.mesh_sequence(
        sequence.vertices.astype(np.float32), grid=sequence.grid, topology="cup", unit="mm"
    )
    found = remote.signature_of(raw, template=template.id, **reading)
    own = mm.modal_signature(
        narrow,
        mm.SignatureParameters(template=template.id),
        template=mm.make_template(narrow),
    )
    assert np.array_equal(found.amplitudes, own.amplitudes)
    assert narrow.id == found.sequence_id
    assert narrow.id not in [info.id for info in remote.sequences()]
    with pytest.raises(mm.NotFoundError):
        remote.signature_of(raw, template="0" * 64, **reading)


@pytest.mark.parametrize(
    ("accept", "n_bytes"),
    [("application/octet-stream", 25 * 7 * 3 * 4), ("application/x-npz", None)],
)
def test_the_signature_of_an_upload_as_plain_numbers(
    service: RunningService, sequence: mm.MeshSequence, accept: str, n_bytes: int | None
) -> None:
    own = mm.modal_signature(sequence)
    answer = service.request("POST", "/v1/signature", mm.write_npz(sequence), {"Accept": accept})
    assert answer.headers["content-type"] == accept
    if n_bytes is None:
        with np.load(io.BytesIO(answer.body)) as archive:
            assert np.array_equal(archive["amplitudes"], own.amplitudes)
    else:
        assert len(answer.body) == n_bytes
        found = np.frombuffer(answer.body, "<f4").reshape(own.amplitudes.shape)
        assert np.array_equal(found, own.amplitudes.astype("<f4"))
    json = service.request("POST", "/v1/signature", mm.write_npz(sequence)).json
    assert np.array_equal(np.array(json["amplitudes"]), own.amplitudes)
    assert json["file"] is None


def test_many_signatures_come_in_order_however_many_the_service_gives_at_once(
    remote: Client,
) -> None:
    sequences = [small(seed) for seed in range(5)]
    ids = [remote.upload(one, label=f"class {k}").id for k, one in enumerate(sequences)]
    steps: list[Progress] = []
    found = remote.signatures(ids, modes=4, progress=steps.append)
    assert [one.id for one in found] == ids
    assert [one.label for one in found] == [f"class {k}" for k in range(5)]
    assert steps == [Progress(k, 5) for k in (2, 4, 5)]
    for one, original in zip(found, sequences, strict=True):
        own = mm.modal_signature(original, mm.SignatureParameters(modes=4))
        assert np.array_equal(one.amplitudes, own.amplitudes)
        assert tuple(one.modes) == tuple(map(str, own.modes.labels))
    assert remote.signatures([]) == []


def test_surfaces_distances_and_classes(
    remote: Client, sequence: mm.MeshSequence, tmp_path: Path
) -> None:
    other = mm.simulate_ventricle(rng=np.random.default_rng(3))
    here, there = remote.upload(sequence).id, remote.upload(other).id
    surfaces = remote.reconstruction(here, times=[0.0, 0.11])
    assert surfaces.vertices.shape == (2, *sequence.vertices.shape[1:])
    remote.save("reconstruction", tmp_path / "beat.glb", here)
    assert (tmp_path / "beat.glb").read_bytes()[:4] == b"glTF"
    with pytest.raises(mm.ParameterError, match=r"\.npz, \.vtkhdf"):
        remote.save("reconstruction", tmp_path / "beat.xyz", here)
    own = compare(mm.modal_signature(sequence), mm.modal_signature(other))
    assert remote.distance(here, there) == own
    answer = remote.classify(here)
    assert answer.label == "normal"
    assert answer.probability == max(answer.probabilities.values())
    assert [one.model_id for one in remote.classifications(here)] == [answer.model_id]


def test_streams_hold_their_bound(remote: Client, sequence: mm.MeshSequence) -> None:
    sent = remote.encode(sequence, max_error=0.5)
    decoded = remote.decode(sent.data)
    assert np.abs(decoded.vertices - sequence.vertices).max() <= 0.5
    assert sent.max_error <= 0.5
    some = remote.decode(sent.data, first=3, stop=6)
    assert np.array_equal(some.vertices, decoded.vertices[3:6])
    kept = remote.encoded(remote.upload(sequence).id, max_error=0.5)
    assert kept.data == sent.data


def test_sequences_are_listed_page_by_page_named_and_deleted(remote: Client) -> None:
    ids = [remote.upload(small(100 + k), subject="listed").id for k in range(5)]
    assert [info.id for info in remote.sequences(subject="listed", page=2)] == ids[::-1]
    assert remote.update(ids[0], label="normal").subject == "listed"
    assert remote.update(ids[0], subject=None).label == "normal"
    assert remote.sequence(ids[0]).subject is None
    remote.delete(ids[0])
    with pytest.raises(mm.NotFoundError) as caught:
        remote.sequence(ids[0])
    assert isinstance(caught.value, RemoteError)
    assert (caught.value.status, caught.value.code) == (404, "not_found")


def test_jobs_are_waited_for(remote: Client, sequence: mm.MeshSequence) -> None:
    upload = remote.start_upload(sequence, label="job")
    assert upload.wait().id == sequence.id
    steps: list[Progress] = []
    job = remote.start_signature(sequence.id, modes=11)
    signature = job.wait(progress=steps.append)
    assert len(signature.modes) == 11
    assert steps[-1].share == 1
    assert job.status.state == "succeeded"
    assert job.id in [status.id for status in remote.jobs(state="succeeded")]
    again = remote.job(job.id, "application/json").wait()
    assert again.json["shape"] == list(signature.amplitudes.shape)
    with pytest.raises(RemoteError) as caught:
        job.cancel()
    assert caught.value.code == "conflict"


def test_a_job_that_fails_raises_its_problem(remote: Client) -> None:
    job = remote.start_upload(b"no file at all")
    with pytest.raises(mm.MalformedFileError) as caught:
        job.wait()
    assert caught.value.remedy
    assert caught.value.details["job"] == job.id


def test_a_job_that_is_ended_or_not_finished_says_so(remote: Client) -> None:
    beat = mm.simulate_ventricle(
        grid=(128, 128), acquisition=mm.Acquisition(n_frames=4), rng=np.random.default_rng(1)
    )
    job = remote.start_signature(remote.upload(beat).id, modes=60, topology="mesh")
    with pytest.raises(JobUnfinishedError):
        job.wait(timeout=0.0)
    job.cancel()
    with pytest.raises(JobCancelledError):
        job.wait()


def test_errors_carry_frame_vertex_limit_remedy_and_the_requests_id(
    service: RunningService, remote: Client, sequence: mm.MeshSequence
) -> None:
    vertices = np.array(sequence.vertices)
    vertices[3, 7, 1] = np.nan
    buffer = io.BytesIO()
    np.savez(buffer, vertices=vertices)
    with pytest.raises(mm.NonFiniteError) as caught:
        remote.upload(buffer.getvalue())
    error = caught.value
    assert isinstance(error, RemoteError)
    assert (error.frame, error.vertex, error.code) == (3, 7, "non_finite")
    assert error.remedy
    assert error.request_id
    # The line is written once the answer has gone.
    for _ in range(100):
        if error.request_id in service.log.read_text():
            break
        time.sleep(0.02)
    else:
        raise AssertionError("the log does not name the request")
    with pytest.raises(mm.LimitError) as limited:
        remote.upload(bytes(6_000_000))
    assert limited.value.limit == "body_bytes"
    assert limited.value.details["most"] == 5_000_000


def test_errors_survive_pickling(remote: Client) -> None:
    with pytest.raises(mm.NotFoundError) as caught:
        remote.sequence("0" * 64)
    again = pickle.loads(pickle.dumps(caught.value))  # noqa: S301 (our own)
    assert type(again) is type(caught.value)
    assert vars(again) == vars(caught.value)


def test_every_problem_becomes_an_error_of_the_library() -> None:
    unknown = remote_error({"code": "of_a_newer_service", "detail": "x"}, 418, "id")
    assert (unknown.code, unknown.status, unknown.request_id) == ("of_a_newer_service", 418, "id")
    assert type(unknown).__mro__[1] is RemoteError
    for body in (b"<html>", b"[]", b'"text"', b"{"):
        error = error_of_answer(502, body, "application/json", "")
        assert error.status == 502
        assert error.remedy
    strange = remote_error({"code": 7, "frame": "x", "vertex": None, "limit": [], "detail": 3}, 500)
    assert (strange.code, strange.frame, strange.limit) == ("remote_error", None, None)


@pytest.mark.parametrize(
    ("header", "seconds"),
    [(None, None), ("7", 7.0), (" 0 ", 0.0), ("-1", None), ("soon", None), ("9" * 40, None)],
)
def test_retry_after_in_seconds(header: str | None, seconds: float | None) -> None:
    assert retry_after(header) == seconds


def test_an_address_that_is_none_is_refused_and_a_key_is_not_shown(service: RunningService) -> None:
    for address in ("localhost:8000", "ftp://here", "http://"):
        with pytest.raises(mm.ParameterError, match="address"):
            Client(address)
    with Client(service.base, key="secret") as client:
        assert client.is_ready()
        assert "secret" not in repr(client)


def test_an_answer_that_is_something_else_is_named(remote: Client) -> None:
    answer = remote.request("GET", "/docs", accept="text/html")
    with pytest.raises(BrokenAnswerError):
        _ = answer.json
