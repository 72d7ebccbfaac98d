"""Inference by the open inference protocol: the answers of `/v1`, bit for bit."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from modalmotion_service.http.tensors import HEADER, MOST_JSON

MODEL = "ventricle-simulated"
HERE = f"/v2/models/{MODEL}/infer"


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


def request_of(**changes: Any) -> dict[str, Any]:
    sent = {"name": "sequence", "shape": [1], "datatype": "BYTES"}
    return {"inputs": [{**sent, **changes.pop("sent", {})}], **changes}


def binary(data: bytes, **changes: Any) -> tuple[bytes, dict[str, str]]:
    """Body and header of a request with a file behind the JSON."""
    tensor = struct.pack("<I", len(data)) + data
    sent = {"parameters": {"binary_data_size": len(tensor)}, **changes.pop("sent", {})}
    head = json.dumps(request_of(sent=sent, **changes)).encode()
    return head + tensor, {HEADER: str(len(head))}


@pytest.fixture(scope="module")
def of_v1(client: TestClient, beat: bytes) -> dict[str, Any]:
    answer: dict[str, Any] = client.post(
        "/v1/classify", params={"model": MODEL}, content=beat
    ).json()
    return answer


def by_name(answer: dict[str, Any]) -> dict[str, list[Any]]:
    return {one["name"]: one["data"] for one in answer["outputs"]}


def test_a_file_behind_json_is_classified_as_by_v1(
    client: TestClient, beat: bytes, of_v1: dict[str, Any]
) -> None:
    body, headers = binary(beat, id="17")
    answer = client.post(HERE, content=body, headers=headers)
    assert answer.status_code == 200, answer.text
    said = answer.json()
    assert (said["model_name"], said["model_version"], said["id"]) == (MODEL, "1", "17")
    found = by_name(said)
    assert found["probabilities"] == list(of_v1["probabilities"].values())
    assert found["label"] == [of_v1["label"] or ""]
    assert found["class_set"] == of_v1["class_set"]
    version = client.post(
        f"/v2/models/{MODEL}/versions/1/infer", content=body, headers=headers
    ).json()
    assert version == said
    metadata = client.get(f"/v2/models/{MODEL}").json()
    assert [one["name"] for one in metadata["outputs"]] == [one["name"] for one in said["outputs"]]
    assert client.get("/v2").json()["extensions"] == ["binary_tensor_data"]


def test_outputs_come_in_binary_bit_for_bit(
    client: TestClient, beat: bytes, of_v1: dict[str, Any]
) -> None:
    outputs = [
        {"name": "probabilities", "parameters": {"binary_data": True}},
        {"name": "label", "parameters": {"binary_data": False}},
    ]
    body, headers = binary(beat, outputs=outputs)
    answer = client.post(HERE, content=body, headers=headers)
    n = int(answer.headers[HEADER])
    first, second = json.loads(answer.content[:n])["outputs"]
    data = answer.content[n:]
    assert first["parameters"] == {"binary_data_size": len(data)}
    assert np.frombuffer(data, "<f8").tolist() == list(of_v1["probabilities"].values())
    assert second["data"] == [of_v1["label"] or ""]
    body, headers = binary(beat, parameters={"binary_data_output": True})
    answer = client.post(HERE, content=body, headers=headers)
    head = json.loads(answer.content[: int(answer.headers[HEADER])])
    assert all("data" not in one for one in head["outputs"])
    sizes = [one["parameters"]["binary_data_size"] for one in head["outputs"]]
    assert len(answer.content) == int(answer.headers[HEADER]) + sum(sizes)


def test_parameters_are_those_of_classify(
    client: TestClient, beat: bytes, of_v1: dict[str, Any]
) -> None:
    body, headers = binary(beat, parameters={"coverage": 0.5})
    surer = by_name(client.post(HERE, content=body, headers=headers).json())
    assert set(surer["class_set"]) <= set(of_v1["class_set"])
    for parameters, said in (
        ({"coverage": 2}, "coverage"),
        ({"colour": "red"}, "colour"),
        ({"model": "other"}, "address"),
    ):
        body, headers = binary(beat, parameters=parameters)
        refused = client.post(HERE, content=body, headers=headers)
        assert refused.status_code == 422
        assert said in refused.json()["error"]
        assert refused.json()["remedy"]


def test_text_may_stand_in_the_json(client: TestClient) -> None:
    data = "x,y,z\n1,2,3\n"
    answer = client.post(HERE, json=request_of(sent={"data": [data]}))
    # Read as a file, which this is none of.
    assert answer.status_code in (400, 422)
    assert answer.json()["error"] == answer.json()["detail"]


@pytest.mark.parametrize(
    ("status", "content", "headers"),
    [
        (400, b"", {}),
        (400, b"[]", {}),
        (400, b"{", {}),
        (400, b"{}", {}),
        (400, b"\xff\xfe", {}),
        (400, b"{}", {HEADER: "9"}),
        (400, b"{}", {HEADER: "-2"}),
        (400, b"{}", {HEADER: "two"}),
        (413, b"{}", {HEADER: str(MOST_JSON + 1)}),
        (413, b" " * (MOST_JSON + 1), {}),
        (413, b"[" * 60_000, {}),
        (400, json.dumps(request_of()).encode(), {}),
        (400, json.dumps(request_of(sent={"shape": [2]})).encode(), {}),
        (400, json.dumps(request_of(sent={"datatype": "FP32", "data": ["x"]})).encode(), {}),
        (400, json.dumps(request_of(sent={"name": "other", "data": ["x"]})).encode(), {}),
        (400, json.dumps({"inputs": []}).encode(), {}),
        (400, json.dumps(request_of(sent={"data": ["x"]}, outputs=[{"name": "a"}])).encode(), {}),
    ],
)
def test_what_is_no_request_is_refused_with_a_remedy(
    client: TestClient, status: int, content: bytes, headers: dict[str, str]
) -> None:
    answer = client.post(HERE, content=content, headers=headers)
    assert answer.status_code == status, answer.text
    assert answer.json()["remedy"]


def test_sizes_that_do_not_agree_are_refused(client: TestClient, beat: bytes) -> None:
    body, headers = binary(beat)
    n = int(headers[HEADER])
    longer = body[:n] + struct.pack("<I", len(beat) + 1) + body[n + 4 :]
    for wrong in (body[:-1], body + b"x", longer, body[: n + 2]):
        answer = client.post(HERE, content=wrong, headers=headers)
        assert answer.status_code == 400
        assert "stated to have" in answer.json()["error"]
    both, headers = binary(beat, sent={"data": ["x"]})
    assert "once" in client.post(HERE, content=both, headers=headers).json()["error"]
    unknown = client.post("/v2/models/nobodys/infer", content=body, headers=headers)
    assert unknown.status_code == 404
    assert not list(client.app.state.owners.local.spool.folder.iterdir())  # type: ignore[attr-defined]


# A server of its own is asked by another's client: 2 s.
def test_a_client_of_the_protocol_infers(tmp_path: Any, beat: bytes, of_v1: dict[str, Any]) -> None:
    http = pytest.importorskip("tritonclient.http")
    from running import RunningService

    service = RunningService(tmp_path / "results", {"WORKERS": "1"}).start()
    try:
        asked = http.InferenceServerClient(f"127.0.0.1:{service.port}")
        assert asked.is_server_live()
        assert asked.is_model_ready(MODEL)
        sent = http.InferInput("sequence", [1], "BYTES")
        sent.set_data_from_numpy(np.array([beat], dtype=object))
        wanted = [
            http.InferRequestedOutput("probabilities", binary_data=True),
            http.InferRequestedOutput("class_set", binary_data=False),
        ]
        result = asked.infer(MODEL, [sent], outputs=wanted)
        assert result.as_numpy("probabilities").tolist() == list(of_v1["probabilities"].values())
        assert result.as_numpy("class_set").astype(str).tolist() == of_v1["class_set"]
        whole = asked.infer(MODEL, [sent], model_version="1")
        assert whole.as_numpy("label").tolist() == [(of_v1["label"] or "").encode()]
        sent.set_data_from_numpy(np.array([b"no file"], dtype=object))
        with pytest.raises(Exception, match=r"^\[400\] ") as refused:
            asked.infer(MODEL, [sent])
        assert "while decoding" not in str(refused.value)
        asked.close()
    finally:
        service.stop()


@pytest.mark.soak
def test_of_mutated_requests_none_is_a_fault_of_ours(client: TestClient, beat: bytes) -> None:
    rng = np.random.default_rng(22)
    small, headers = binary(b"no file")
    whole, whole_headers = binary(beat)
    statuses: dict[int, int] = {}
    for number in range(10_000):
        body, own = (whole, whole_headers) if number % 500 == 0 else (small, headers)
        n = int(own[HEADER])
        mutated = bytearray(body)
        for _ in range(rng.integers(1, 5)):
            kind, at = rng.integers(4), int(rng.integers(max(n + 8, 1)))
            if kind == 0 and mutated:
                mutated[at % len(mutated)] = int(rng.integers(256))
            elif kind == 1:
                del mutated[at : at + int(rng.integers(1, 9))]
            elif kind == 2:
                mutated[at:at] = bytes(rng.integers(0, 256, int(rng.integers(1, 9)), np.uint8))
            else:
                mutated[at:at] = mutated[max(0, at - 12) : at]
        length = str(n if rng.integers(4) else int(rng.integers(0, n + 20)))
        answer = client.post(HERE, content=bytes(mutated), headers={HEADER: length})
        statuses[answer.status_code] = statuses.get(answer.status_code, 0) + 1
        assert answer.status_code < 500, bytes(mutated)
    assert sum(statuses.values()) == 10_000
