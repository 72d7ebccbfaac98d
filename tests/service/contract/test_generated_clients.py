"""Clients that others generate from the document do the whole task, files included."""

from __future__ import annotations

import importlib
import io
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from project import ROOT
from running import RunningService

import modalmotion as mm

DOCUMENT = ROOT / "openapi" / "openapi.json"
TYPESCRIPT = Path(__file__).parent / "typescript"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningService]:
    running = RunningService(tmp_path_factory.mktemp("generated") / "data")
    try:
        yield running.start()
    finally:
        running.stop()


@pytest.fixture(scope="module")
def sequence() -> mm.MeshSequence:
    few = mm.Acquisition(n_frames=6)
    return mm.simulate_ventricle(grid=(8, 16), acquisition=few, rng=np.random.default_rng(4))


def generated(folder: Path) -> str:
    """Generate the Python client; gives its package's name."""
    pytest.importorskip("openapi_python_client")
    name = "generated_client"
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--meta", "none"]
    run = subprocess.run(
        [*command, "--path", str(DOCUMENT), "--output-path", str(folder / name)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    # What it cannot describe it leaves out, with a warning.
    assert "WARNING" not in run.stdout, run.stdout
    return name


def vertices_of(data: bytes) -> np.ndarray:
    return mm.read_npz(data).sequence.vertices


def test_python(
    service: RunningService,
    sequence: mm.MeshSequence,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    name = generated(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    package = importlib.import_module(name)
    types, models = (importlib.import_module(f"{name}.{part}") for part in ("types", "models"))

    def call(room: str, function: str) -> Any:
        return importlib.import_module(f"{name}.api.{room}.{function}").sync

    def file(data: bytes) -> Any:
        return types.File(payload=io.BytesIO(data), mime_type="application/octet-stream")

    body = mm.write_npz(sequence)
    with package.Client(base_url=service.base) as client:
        sent = call("sequences", "upload_sequence")(client=client, body=file(body))
        assert sent.id == sequence.id
        wanted = models.SignatureRequest(modes=7)
        signature = call("signatures", "make_signature")(sent.id, client=client, body=wanted)
        expected = mm.modal_signature(sequence, mm.SignatureParameters(modes=7))
        np.testing.assert_allclose(signature.amplitudes, expected.amplitudes, rtol=1e-12)
        usual = call("signatures", "make_signature")(sent.id, client=client)
        assert usual.key == signature.key
        answer = call("signatures", "classify_signature")(signature.key, client=client)
        assert sum(answer.probabilities.to_dict().values()) == pytest.approx(1.0)
        at = models.EncodingOfFile(rms=0.5)
        sent_stream = call("files", "encode_file")(client=client, body=file(body), parameters=at)
        stream = sent_stream.payload.read()
        decoded = call("files", "decode_file")(client=client, body=file(stream)).payload.read()
        assert np.sqrt(np.mean((vertices_of(decoded) - sequence.vertices) ** 2) * 3) <= 0.5
        rebuilt = call("signatures", "reconstruct_signature")(signature.key, client=client)
        assert vertices_of(rebuilt.payload.read()).shape == sequence.vertices.shape
        refused = call("sequences", "upload_sequence")(client=client, body=file(b"nothing"))
        assert refused.status == 400
        assert refused.remedy


def test_typescript(service: RunningService, sequence: mm.MeshSequence, tmp_path: Path) -> None:
    node, packages = shutil.which("node"), TYPESCRIPT / "node_modules"
    if node is None or not packages.is_dir():
        pytest.skip("needs node, and `npm ci` in the folder of the client")
    for path in TYPESCRIPT.glob("[!n]*"):
        shutil.copy(path, tmp_path)
    (tmp_path / "node_modules").symlink_to(packages)

    def run(*words: str) -> str:
        done = subprocess.run(
            [node, *words], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    # What has a default need not be stated.
    words = (str(DOCUMENT), "-o", "schema.d.ts", "--default-non-nullable=false")
    run(f"{packages}/openapi-typescript/bin/cli.js", *words)
    run(f"{packages}/typescript/bin/tsc", "-p", ".")
    (tmp_path / "beat.npz").write_bytes(mm.write_npz(sequence))
    said = json.loads(run("client.js", service.base, "beat.npz", "."))
    assert said["id"] == sequence.id
    expected = mm.modal_signature(sequence, mm.SignatureParameters(modes=7))
    np.testing.assert_allclose(said["amplitudes"], expected.amplitudes, rtol=1e-12)
    assert sum(said["probabilities"].values()) == pytest.approx(1.0)
    decoded, rebuilt = (
        vertices_of((tmp_path / name).read_bytes())
        for name in ("decoded.npz", "reconstruction.npz")
    )
    assert np.sqrt(np.mean((decoded - sequence.vertices) ** 2) * 3) <= 0.5
    assert rebuilt.shape == sequence.vertices.shape
    assert re.fullmatch(r"[a-z_]+", said["refusal"])


def test_every_reference_of_the_document_leads_somewhere() -> None:
    document = json.loads(DOCUMENT.read_text())
    for reference in set(re.findall(r'"\$ref": ?"#/([^"]+)"', json.dumps(document))):
        place = document
        for name in reference.split("/"):
            assert name in place, reference
            place = place[name]
