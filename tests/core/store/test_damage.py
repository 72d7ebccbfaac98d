"""A file that is damaged, foreign or hostile is named and refused."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from store_samples import sample_classification, sample_sequence, sample_signature

from modalmotion.errors import CorruptFileError, NotFoundError, StoreError
from modalmotion.hdf5.image import Attribute, json_text, sealed_image
from modalmotion.hdf5.sealed import SEAL_LENGTH, digest_of, seal
from modalmotion.store import (
    classification_from_hdf5,
    classification_to_hdf5,
    sequence_to_hdf5,
    signature_from_hdf5,
    signature_to_hdf5,
)


@cache
def sample_image() -> bytes:
    return signature_to_hdf5(sample_signature(sample_sequence(1)))


def test_the_seal_is_the_digest_of_what_lies_before_it() -> None:
    image = sample_image()
    assert seal(image[:-SEAL_LENGTH]) == image
    assert digest_of(image) in image[-SEAL_LENGTH:].decode()


@pytest.mark.parametrize("step", [1, 128])
def test_no_flipped_byte_goes_unnoticed(step: int) -> None:
    image = bytearray(classification_to_hdf5(sample_classification("1" * 64)))
    for place in range(0, len(image), 61):
        image[place] ^= step
        with pytest.raises(CorruptFileError):
            classification_from_hdf5(bytes(image))
        image[place] ^= step
    classification_from_hdf5(bytes(image))


@given(st.data())
def test_damage_of_any_kind_is_named(data: Any) -> None:
    image = sample_image()
    start = data.draw(st.integers(0, len(image) - 1))
    stop = data.draw(st.integers(start, min(len(image), start + 4096)))
    put = data.draw(st.binary(max_size=50))
    damaged = image[:start] + put + image[stop:]
    if damaged == image:
        return
    with pytest.raises(CorruptFileError) as caught:
        signature_from_hdf5(damaged)
    assert caught.value.remedy


@pytest.mark.parametrize("length", [0, 1, 7, 8, 9, 100, SEAL_LENGTH, 5000, -SEAL_LENGTH, -1])
def test_a_file_cut_short_is_damaged(length: int) -> None:
    image = sample_image()
    with pytest.raises(CorruptFileError):
        signature_from_hdf5(image[:length])


def test_an_error_names_the_file_but_no_folder(tmp_path: Path) -> None:
    path = tmp_path / "result.h5"
    with pytest.raises(NotFoundError, match=r"result\.h5") as missing:
        signature_from_hdf5(path)
    path.write_bytes(b"\x89HDF\r\n\x1a\n but no more")
    with pytest.raises(CorruptFileError, match=r"result\.h5") as corrupt:
        signature_from_hdf5(path)
    with pytest.raises(StoreError) as folder:
        signature_from_hdf5(tmp_path)
    for caught in (missing, corrupt, folder):
        assert str(tmp_path.parent) not in str(caught.value)
        assert caught.value.remedy
        assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)  # noqa: S301


@pytest.mark.parametrize("text", [b"", b"text", b"PK\x03\x04" * 40])
def test_what_is_no_hdf5_is_refused_as_such(text: bytes) -> None:
    with pytest.raises(CorruptFileError, match=r"empty|HDF5"):
        signature_from_hdf5(text)


def test_hdf5_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.h5"
    with h5py.File(path, "w") as file:
        file["amplitudes"] = np.zeros((2, 2, 3))
    with pytest.raises(CorruptFileError, match="seal"):
        signature_from_hdf5(path)
    with pytest.raises(CorruptFileError, match="does not contain a signature"):
        signature_from_hdf5(seal(path.read_bytes()))


def test_another_kind_of_file_is_named() -> None:
    image = sequence_to_hdf5(sample_sequence(1))
    with pytest.raises(CorruptFileError, match=r"contains 'sequence', not a signature"):
        signature_from_hdf5(image)


@pytest.mark.parametrize("version", [0, 8, 999])
def test_a_newer_schema_is_refused_by_its_number(version: int) -> None:
    attributes: dict[str, Attribute] = {
        "schema": "modalmotion.signature",
        "schema_version": version,
    }
    image = sealed_image(attributes, [json_text("notes", [])])
    with pytest.raises(CorruptFileError, match=f"version {version}") as caught:
        signature_from_hdf5(image)
    assert caught.value.details == {"schema_version": version, "known": 7}


def changed(image: bytes, path: Path, change: Callable[[h5py.File], None]) -> bytes:
    """The same file after a change through the HDF5 library, sealed again."""
    path.write_bytes(image[:-SEAL_LENGTH])
    with h5py.File(path, "r+") as file:
        change(file)
    return seal(path.read_bytes())


def _delete(name: str) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]

    return change


def _replace(name: str, value: Any) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        del file[name]
        file[name] = value

    return change


def _drop_topology(file: h5py.File) -> None:
    del file.attrs["topology"]


def _unknown_topology(file: h5py.File) -> None:
    file.attrs["topology"] = np.bytes_("Klein bottle")


def _group_instead(file: h5py.File) -> None:
    del file["lengths"]
    file.create_group("lengths")


def _fill_values_instead(file: h5py.File) -> None:
    # A petabyte in a file of 18 kB: HDF5 would make it up from the fill value.
    del file["amplitudes"]
    file.create_dataset("amplitudes", (2**40, 7, 3), "<f8")


def _chunks_instead(file: h5py.File) -> None:
    del file["amplitudes"]
    file.create_dataset("amplitudes", (4, 7, 3), "<f8", chunks=(4, 7, 3), compression="gzip")


def _object_instead(file: h5py.File) -> None:
    file.attrs["topology"] = "cup"


@pytest.mark.parametrize(
    "change",
    [
        _delete("amplitudes"),
        _delete("notes"),
        _replace("amplitudes", np.zeros((4, 6, 3))),
        _replace("amplitudes", np.zeros(7)),
        _replace("amplitudes", np.array([b"text"] * 4)),
        _replace("rms_errors", np.zeros(5)),
        _replace("parameters", np.bytes_(b"{")),
        _replace("parameters", np.bytes_(b"[]")),
        _replace("parameters", np.bytes_(b'{"modes": 0}')),
        _replace("parameters", np.bytes_(b'{"modes": 7, "later": 1}')),
        _replace("n_vertices", np.zeros(2)),
        _drop_topology,
        _unknown_topology,
        _group_instead,
        _fill_values_instead,
        _chunks_instead,
        _object_instead,
    ],
)
def test_a_sealed_file_with_other_contents_is_refused(
    change: Callable[[h5py.File], None], tmp_path: Path
) -> None:
    image = sample_image()
    with pytest.raises(CorruptFileError) as caught:
        signature_from_hdf5(changed(image, tmp_path / "a.h5", change))
    assert caught.value.remedy


def test_no_link_leads_out_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(bytes(4 * 7 * 3 * 8))
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["amplitudes"] = np.zeros((4, 7, 3))
    image = sample_image()

    def external_link(file: h5py.File) -> None:
        del file["amplitudes"]
        file["amplitudes"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/amplitudes")

    def soft_link(file: h5py.File) -> None:
        del file["p95_errors"]
        file["p95_errors"] = h5py.SoftLink("/max_errors")

    def external_storage(file: h5py.File) -> None:
        del file["amplitudes"]
        place = [(str(tmp_path / "secret"), 0, 4 * 7 * 3 * 8)]
        file.create_dataset("amplitudes", (4, 7, 3), "<f8", external=place)

    def virtual(file: h5py.File) -> None:
        del file["amplitudes"]
        layout = h5py.VirtualLayout((4, 7, 3), "<f8")
        layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "amplitudes", (4, 7, 3))
        file.create_virtual_dataset("amplitudes", layout)

    for change in (external_link, soft_link, external_storage, virtual):
        with pytest.raises(CorruptFileError):
            signature_from_hdf5(changed(image, tmp_path / "a.h5", change))
