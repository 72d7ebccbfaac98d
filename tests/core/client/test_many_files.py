"""Many files through the client: in as few requests as are allowed, each with its own result."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from running import RunningService

from modalmotion.client import Client, RemoteError
from modalmotion.client.bodies import body_of, form_body
from modalmotion.client.many_files import in_requests, named_bodies
from modalmotion.errors import ParameterError
from modalmotion.formats import read_npz


@pytest.fixture(scope="module")
def remote(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    settings = {"WORKERS": "1", "MAX_BATCH_FILES": "2"}
    running = RunningService(tmp_path_factory.mktemp("service") / "results", settings)
    running.start()
    with Client(running.base) as client:
        yield client
    running.stop()


def test_each_has_its_result_or_its_error(remote: Client, beat: bytes, tmp_path: Path) -> None:
    path = tmp_path / 'a "beat".npz'
    path.write_bytes(beat)
    steps: list[tuple[int, int]] = []
    found = remote.signatures_of(
        [path, b"nothing", read_npz(beat).sequence],
        modes=3,
        progress=lambda done, total: steps.append((done, total)),
    )
    assert [one.name for one in found] == [path.name, "1", "2"]
    assert steps == [(2, 3), (3, 3)]
    own = remote.signature_of(beat, modes=3)
    for one in (found[0], found[2]):
        assert np.array_equal(one.require().amplitudes, own.amplitudes)
    with pytest.raises(RemoteError, match="no format") as broken:
        found[1].require()
    with pytest.raises(type(broken.value)) as alone:
        remote.signature_of(b"nothing", modes=3)
    assert (broken.value.message, broken.value.code) == (alone.value.message, alone.value.code)
    # The same file under two names, with what a table says of each.
    named = remote.classes_of(
        {"x.npz": beat, "y.npz": beat}, manifest="path,age\nx.npz,61\ny.npz,\n"
    )
    assert [one.require().label for one in named] == [remote.classify_of(beat).label] * 2
    with pytest.raises(ParameterError, match="3 files with a manifest"):
        remote.signatures_of([beat] * 3, manifest="path\n0\n1\n2\n")


def test_files_go_into_as_few_requests_as_are_allowed() -> None:
    files = named_bodies([b"x" * size for size in (10, 20, 5000, 30, 40, 50)])
    parts = [[name for name, _ in part] for part in in_requests(files, 3, 5000)]
    assert parts == [["0", "1"], ["2"], ["3", "4", "5"]]


def test_a_form_is_the_same_bytes_again() -> None:
    form = form_body([("a", body_of(b"1")), ("b", body_of(b"2"))], "path\na\nb\n")
    assert b"".join(form.pieces()) == b"".join(form.pieces())
