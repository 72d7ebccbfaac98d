"""Pages on which sequences are looked at, and what they are sent."""

from __future__ import annotations

import csv
import io
import re
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from signing import signed

from modalmotion.viewer.container import read_container
from modalmotion.viewer.page import script, source_hash, style
from modalmotion_service.http.negotiation import VIEW
from modalmotion_service.work.tasks import signatures
from modalmotion_service.work.tasks.files import Fitted


@pytest.fixture(scope="module")
def client(shared_client: TestClient) -> TestClient:
    return shared_client


@pytest.fixture(scope="module")
def here(client: TestClient, beat: bytes) -> str:
    return f"/v1/signatures/{client.post('/v1/sequences', content=beat).json()['id']}"


@pytest.mark.parametrize("path", ["/", f"/view/{'0' * 64}", f"/images/{'0' * 64}"])
def test_a_page_holds_no_data_and_may_ask_this_service_only(client: TestClient, path: str) -> None:
    answer = client.get(path)
    assert answer.status_code == 200
    policy = answer.headers["content-security-policy"].split("; ")
    assert {"default-src 'none'", "connect-src 'self'"} <= set(policy)
    assert {"require-trusted-types-for 'script'", "trusted-types 'none'"} <= set(policy)
    assert not [rule for rule in policy if "unsafe" in rule or "http" in rule]
    assert answer.headers["cache-control"] == "no-store"
    assert "0" * 64 not in answer.text
    start = re.findall("<script>(.+)</script>", answer.text)[0]
    assert f"script-src 'self' {source_hash(start)}" in policy
    assert f"style-src {source_hash(style())}" in policy
    assert f"<style>{style()}</style>" in answer.text
    assert [client.get(name).text for name in re.findall(r'import\("([^"]+)"', start)] == [script()]


def test_the_script_is_named_by_its_content_and_kept_for_ever(client: TestClient) -> None:
    [name] = re.findall(r'"(/viewer/[^"]+)"', client.get("/").text)
    headers = client.get(name).headers
    assert "immutable" in headers["cache-control"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["content-type"].startswith("text/javascript")
    assert client.get("/viewer/other.js").status_code == 404
    assert client.get("/viewer/..%2Fpayload.py").status_code == 404


def test_a_view_is_the_signature_s_and_the_frames_come_in_pieces(
    client: TestClient, here: str
) -> None:
    four = signed(client, here, modes=4)
    answer = client.get(f"{four}/view")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == VIEW
    assert answer.headers["cache-control"] == "no-store"
    header, arrays = read_container(answer.content)
    own = client.get(four).json()
    assert np.allclose(arrays["amplitudes"], own["amplitudes"], rtol=1e-6)
    assert header["volume"]["share"]["name"] == "ejection fraction"
    whole = read_container(client.get(f"{four}/view?first=0").content)[1]["frames"]
    assert whole.shape == (header["n_frames"], header["n_vertices"], 3)
    part, frames = read_container(client.get(f"{four}/view?first=3&stop=5").content)
    assert (part["first"], len(frames["frames"])) == (3, 2)
    again = client.get(f"{four}/view", headers={"If-None-Match": answer.headers["etag"]})
    assert again.status_code == 304


def test_a_changed_fact_is_seen(client: TestClient, here: str) -> None:
    before = client.get(f"{here}/view").headers["etag"]
    client.patch(
        here.replace("signatures", "sequences"),
        json={"facts": {"landmarks": {"anterior": [0.0, -20.0, 40.0]}}},
    )
    answer = client.get(f"{here}/view", headers={"If-None-Match": before})
    assert answer.status_code == 200
    assert len(read_container(answer.content)[0]["segments"]["names"]) == 17


def test_a_page_of_one_file_is_an_attachment(client: TestClient, here: str) -> None:
    answer = client.get(f"{here}/view", headers={"Accept": "text/html"})
    assert answer.status_code == 200
    assert answer.headers["content-disposition"].endswith('.html"')
    assert "data-payload=" in answer.text


def test_more_frames_than_an_answer_holds_are_refused(
    client: TestClient, here: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    monkeypatch.setattr(signatures, "MOST_FRAME_BYTES", 1_000)
    from modalmotion.errors import LimitError

    store = client.app.state.owners.local.store  # type: ignore[attr-defined]
    sequence_id, key = signed(client, here).rpartition("/")[2].split("-")
    signature = store.signature_path(sequence_id, key)
    record = store.sequence_record(sequence_id)
    one = Fitted(signature, store.sequence_path(sequence_id), None, None, record)
    with pytest.raises(LimitError, match="first and stop") as caught:
        signatures.make_frames(one, 0, None, tmp_path / "frames")
    assert caught.value.limit == "view_frame_bytes"


def test_amplitudes_and_read_outs_are_tables_too(client: TestClient, here: str) -> None:
    four = signed(client, here, modes=4)
    table = client.get(f"{four}/table")
    assert table.content == client.get(four, headers={"Accept": "text/csv"}).content
    assert table.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(table.text)))
    own = np.array(client.get(four).json()["amplitudes"])
    assert np.array_equal([float(row["amplitude"]) for row in rows], own.ravel())
    assert rows[0]["label"] == "(0, 0, cos)"
    assert rows[0]["unit"] == "mm"
    read = client.get(f"{here}/readouts", headers={"Accept": "text/csv"})
    frames = list(csv.DictReader(io.StringIO(read.text)))
    volumes = client.get(f"{here}/readouts").json()["from_signature"]["volumes"]
    assert [float(row["volume_ml"]) for row in frames] == pytest.approx(volumes)
