"""Thousands of damaged files over HTTP: no 5xx, no hang, and the service goes on."""

from __future__ import annotations

import io
import os
import random
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from costly_files import COSTLY
from fastapi.testclient import TestClient
from format_mutants import mutant
from format_samples import VERTICES, VTK_WRITERS, all_files, frame_zip, sequence
from image_files import image_files
from running import RunningService

from modalmotion.codec import encode
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings

FILES = all_files()
for _name, (_suffix, _write) in VTK_WRITERS.items():
    FILES |= {_name: _write(VERTICES[0]), f"{_name} zip": frame_zip(_write, _suffix)}
FILES["stream"] = encode(sequence(unit="mm"), rms=0.1).data
IMAGES = image_files()
FILES |= IMAGES
# Images are taken in, or tracked at once.
IMAGE_ROUTES = (
    "/v1/images",
    "/v1/tracks?modes=2&landmarks=%7B%22apex%22:[0,0,0],%22base%22:[0,0,4]%7D",
)
ROUTES = ("/v1/sequences", "/v1/signature?modes=2", "/v1/templates", "/v1/encode?rms=0.5")
SOAK = int(os.environ.get("SOAK", "1"))


def route_of(name: str, number: int) -> str:
    """Most to the plain upload; every third to another route."""
    if name == "stream":
        return "/v1/decode"
    if name in IMAGES:
        return IMAGE_ROUTES[number % 3 == 0]
    return ROUTES[number // 3 % len(ROUTES)] if number % 3 == 0 else ROUTES[0]


def send_mutants(folder: Path, n_each: int, files: Mapping[str, bytes]) -> int:
    settings = Settings(
        data_dir=folder,
        max_frames=1000,
        max_vertices=100_000,
        max_faces=100_000,
        max_decompressed_bytes=20_000_000,
        max_image_bytes=20_000_000,
        task_seconds=30,
    )
    n_sent = 0
    with TestClient(create_app(settings), raise_server_exceptions=False) as client:
        for place, (name, data) in enumerate(files.items()):
            # Other numbers for each, so that few of each go to every route.
            for number in range(place * n_each, (place + 1) * n_each):
                route, content = route_of(name, number), mutant(name, data, number)
                # Every fifth as a form, whose end may stand in the file itself.
                if number % 5 == 0:
                    answer = client.post(route, files={"file": ("x", io.BytesIO(content))})
                else:
                    answer = client.post(route, content=content)
                n_sent += 1
                assert answer.status_code < 500, (name, number, route, answer.text)
                if answer.status_code >= 400:
                    assert answer.json()["remedy"], (name, number, route)
        assert client.get("/health/ready").status_code == 200
        assert list((folder / "spool").iterdir()) == []
    return n_sent


def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    assert send_mutants(tmp_path / "results", 3, FILES) >= 100


@pytest.mark.soak
def test_twenty_thousand_damaged_files(tmp_path: Path) -> None:
    n_each = -(-20_000 * SOAK // len(FILES))
    n_sent = send_mutants(tmp_path / "results", n_each, FILES)
    n_vtk = n_each * sum(name.startswith("vt") and "hdf" not in name for name in FILES)
    print(f"{n_sent} mutants of {len(FILES)} files, {n_vtk} of VTK's: no 5xx")  # noqa: T201
    assert n_sent >= 20_000
    assert n_vtk >= 2_000


@pytest.mark.soak
def test_twenty_thousand_damaged_images(tmp_path: Path) -> None:
    """Of DICOM, NIfTI and NRRD, and beside them MetaImage: half an hour beside other work."""
    n_counted = sum(name != "metaimage" for name in IMAGES)
    n_each = -(-20_000 * SOAK // n_counted)
    n_sent = send_mutants(tmp_path / "results", n_each, IMAGES)
    print(f"{n_sent} mutants, {n_each * n_counted} of DICOM, NIfTI and NRRD: no 5xx")  # noqa: T201
    assert n_each * n_counted >= 20_000


def open_files(service: RunningService) -> int:
    return sum(len(list(Path(f"/proc/{pid}/fd").iterdir())) for pid in service.processes())


def cpu_of(service: RunningService, route: str, data: bytes) -> tuple[int, float]:
    """Status of the answer, and processor time of all workers.

    A worker whose time was up for the file before starts anew: that is not this file's work.
    """
    before, last = service.cpu_seconds()["workers"], -1.0
    while before - last > 0.01:
        time.sleep(0.05)
        before, last = service.cpu_seconds()["workers"], before
    answer = service.request("POST", route, data, timeout=120)
    return answer.status, service.cpu_seconds()["workers"] - before


@pytest.mark.soak
def test_costly_files_hold_no_worker_at_any_door(tmp_path: Path) -> None:
    files = {name: make() for name, make in COSTLY.items()}
    # An honest file of each size: numbers that are not packed.
    buffer = io.BytesIO()
    rng = np.random.default_rng(1)
    np.savez(buffer, vertices=rng.normal(size=(10, 4096, 3)), grid=(64, 64), topology="cup")
    service = RunningService(tmp_path / "results", {"WORKERS": "1", "TASK_SECONDS": "120"})
    service.start()
    try:
        for route in ROUTES:
            status, seconds = cpu_of(service, route, buffer.getvalue())
            assert status in (200, 201)
            per_byte = max(seconds, 0.05) / len(buffer.getvalue())
            handles, memory = open_files(service), service.memory()
            for name, data in files.items():
                status, spent = cpu_of(service, route, data)
                assert 200 <= status < 500, (route, name, status)
                assert spent < max(2.0, 20 * per_byte * len(data)), (route, name, spent)
            assert open_files(service) <= handles + 10
            assert service.memory() < memory + 500_000_000
    finally:
        service.stop()


def test_a_mutant_is_the_same_for_the_same_number() -> None:
    data = random.Random(1).randbytes(100)  # noqa: S311 - no secret
    assert mutant("ply", data, 7) == mutant("ply", data, 7)
