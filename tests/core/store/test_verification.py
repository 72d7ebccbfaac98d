"""Verification finds every fault and changes nothing."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from damaged_stores import N, damage, flip_signature, flip_upload, four_kept
from store_samples import KEY, MODEL, sample_sequence, sample_signature, tree

from modalmotion.errors import NotFoundError, StoreError
from modalmotion.exports.signature_pack import export
from modalmotion.hdf5.sealed import SEAL_LENGTH, seal
from modalmotion.notes import Note
from modalmotion.progress import Progress
from modalmotion.store import ResultStore, rebuild, sequence_to_hdf5, template_to_hdf5, verify
from modalmotion.store.folders import Folder, ResultName
from modalmotion.template import make_template


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return four_kept(tmp_path / "store")


def _flip_template(root: Path) -> None:
    template = make_template(sample_sequence(1))
    path = Folder(root).path("templates", template.id)
    path.parent.mkdir(parents=True)
    path.write_bytes(template_to_hdf5(template))
    assert verify(root).is_sound
    damage(path)


def _flip_classification(root: Path) -> None:
    damage(
        Folder(root).path(
            "results", ResultName("classification", sample_sequence(1).id, MODEL, KEY)
        )
    )


def _cut(root: Path) -> None:
    path = Folder(root).path("uploads", sample_sequence(1).id)
    path.write_bytes(path.read_bytes()[:-1])


def _remove_record(root: Path) -> None:
    Folder(root).path("records", sample_sequence(1).id).unlink()


def _remove_upload(root: Path) -> None:
    Folder(root).path("uploads", sample_sequence(1).id).unlink()


def _remove_result(root: Path) -> None:
    Folder(root).path("results", ResultName("signature", sample_sequence(1).id, "", KEY)).unlink()


def _swap(root: Path) -> None:
    folder = Folder(root)
    a, b = (folder.path("uploads", sample_sequence(number).id) for number in (1, 2))
    content = a.read_bytes()
    a.write_bytes(b.read_bytes())
    b.write_bytes(content)


def _another_record(root: Path) -> None:
    folder = Folder(root)
    a, b = (folder.path("records", sample_sequence(number).id) for number in (1, 2))
    a.write_bytes(b.read_bytes())


def _other_numbers(root: Path) -> None:
    # A sound signature of the same name, but not the one that was kept.
    sequence = sample_sequence(1)
    name = ResultName("signature", sequence.id, "", KEY)
    signature = sample_signature(sequence)
    with ResultStore(root.parent / "other") as other:
        other.put_sequence(sequence)
        path = other.put_signature(replace(signature, notes=(Note("another", "another"),)))
    Folder(root).path("results", name).write_bytes(path.read_bytes())


def _other_vertices(root: Path) -> None:
    # Sealed and under the right id, which does not stand for these vertices.
    one, other = sample_sequence(1), sample_sequence(9)
    image = sequence_to_hdf5(other)[:-SEAL_LENGTH].replace(other.id.encode(), one.id.encode())
    Folder(root).path("uploads", one.id).write_bytes(seal(image))


def _change_index(root: Path) -> None:
    connection = sqlite3.connect(root / "index.sqlite")
    with connection:
        connection.execute("UPDATE sequences SET label = 'other'")
    connection.close()


def _empty_index(root: Path) -> None:
    connection = sqlite3.connect(root / "index.sqlite")
    with connection:
        connection.execute("DELETE FROM sequences")
        connection.execute("DELETE FROM results")
    connection.close()


def _remove_index(root: Path) -> None:
    (root / "index.sqlite").unlink()


def _no_index(root: Path) -> None:
    (root / "index.sqlite").write_bytes(b"text" * 1000)


FAULTS = [
    flip_upload,
    _flip_template,
    flip_signature,
    _flip_classification,
    _cut,
    _remove_record,
    _remove_upload,
    _remove_result,
    _swap,
    _another_record,
    _other_numbers,
    _other_vertices,
    _change_index,
    _empty_index,
    _remove_index,
    _no_index,
]


@pytest.mark.every(3)
@pytest.mark.parametrize("spoil", FAULTS)
def test_verify_finds_the_fault_and_changes_nothing(
    spoil: Callable[[Path], None], root: Path
) -> None:
    assert verify(root).is_sound
    spoil(root)
    before = tree(root)
    report = verify(root)
    assert report.faults
    assert all(str(root) not in f"{fault.file} {fault.problem}" for fault in report.faults)
    assert verify(root) == report
    assert tree(root) == before


def test_verify_counts_what_it_read(root: Path) -> None:
    seen: list[Progress] = []
    report = verify(root, progress=seen.append)
    assert (report.n_sequences, report.n_results) == (N, 3 * N)
    assert report.n_bytes == sum(map(len, tree(root).values()))
    assert seen[-1] == Progress(5 * N + 1, 5 * N + 1)


@pytest.mark.parametrize("look", [rebuild, verify, lambda root: export(root, root / "out.h5")])
def test_a_folder_without_a_store_is_not_made_into_one(
    look: Callable[[Path], object], tmp_path: Path
) -> None:
    with pytest.raises(NotFoundError, match="contains no store"):
        look(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("look", [rebuild, verify, lambda root: export(root, root / "out.h5")])
def test_a_store_that_is_open_is_left_alone(look: Callable[[Path], object], root: Path) -> None:
    with ResultStore(root), pytest.raises(StoreError, match="in use by process"):
        look(root)
