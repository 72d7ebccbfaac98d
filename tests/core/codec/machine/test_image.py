"""Machine code in a file: used where it is whole, and never missed where it is not."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

import numpy as np
import pytest
from codec_sequences import lattice_sequence
from pure_codec import compiled

from modalmotion.codec import decode, encode
from modalmotion.codec.kernels import build
from modalmotion.codec.kernels.build import compile_kernels
from modalmotion.codec.machine import image as images
from modalmotion.errors import ModalMotionError, ParameterError
from modalmotion.numeric.machine import building
from modalmotion.numeric.machine import image as machine


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Images are looked for in an empty folder."""
    monkeypatch.setattr(images, "_mapped", [])
    monkeypatch.setenv(machine.VARIABLE, str(tmp_path))
    return tmp_path


def kept() -> Path:
    return next(p for f in machine.folders() if (p := f / images.file_name()).exists())


@compiled
def test_an_image_serves_from_a_folder_that_may_be_read_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(kept(), tmp_path)
    monkeypatch.setattr(images, "_mapped", [])
    monkeypatch.setenv(machine.VARIABLE, str(tmp_path))
    tmp_path.chmod(0o555)
    found = images.image()
    assert found is not None
    assert set(found.entries) == {"symbols", "waves", "mixed", "surface", "halve", "pair"}
    # It is there: nothing is compiled.
    assert compile_kernels() == tmp_path / images.file_name()


@compiled
@pytest.mark.parametrize("place", [0, 20, -1])
def test_a_damaged_image_is_not_run(
    place: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    rng: np.random.Generator,
) -> None:
    data = bytearray(kept().read_bytes())
    data[place] ^= 1
    (tmp_path / images.file_name()).write_bytes(data)
    monkeypatch.setattr(images, "_mapped", [])
    monkeypatch.setenv(machine.VARIABLE, str(tmp_path))
    sequence = lattice_sequence(rng)
    with caplog.at_level(logging.WARNING):
        decoded = decode(encode(sequence, rms=0.3).data)
    assert np.array_equal(decoded.faces, sequence.faces)
    assert [record.message for record in caplog.records if "cannot be used" in record.message]


def test_the_pure_form_answers_with_one_line_of_log(
    elsewhere: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "is_served", lambda: True)
    with caplog.at_level(logging.WARNING):
        assert images.image() is None
        assert images.image() is None
    assert len(caplog.records) == 1
    assert "modalmotion compile-codec" in caplog.text


def test_off_is_silent(
    elsewhere: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(machine.VARIABLE, machine.OFF)
    assert images.image() is None
    assert not caplog.records
    with pytest.raises(ParameterError, match="No folder"):
        compile_kernels()


def test_other_machines_are_told_that_nothing_is_to_be_done(
    elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(building, "is_served", lambda: False)
    with pytest.raises(ParameterError, match="x86-64"):
        compile_kernels()


def test_code_that_names_others_is_refused() -> None:
    with pytest.raises(ModalMotionError, match="outside of itself"):
        building._resolve(
            bytearray(8), b"\0" * 8 + b"\x02" + b"\0" * 15,
            {"offset": 0, "size": 24, "each": 24}, 0, [("floor", None)],
        )  # fmt: skip


@pytest.mark.soak
def test_compiling_gives_the_code_that_runs() -> None:
    assert build.make_image() == kept().read_bytes()
