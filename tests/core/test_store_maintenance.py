from __future__ import annotations

import errno
import os
import re
import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from store_samples import (
    KEY,
    MODEL,
    assert_same,
    sample_classification,
    sample_model,
    sample_sequence,
    sample_signature,
    tree,
)

from modalmotion.cli.store_commands import store as commands
from modalmotion.errors import CorruptFileError, NotFoundError, StoreError
from modalmotion.modes import ModeSet
from modalmotion.sequence import mesh_sequence
from modalmotion.signature import modal_signature
from modalmotion.store import (
    ResultStore,
    export,
    rebuild,
    sequence_to_hdf5,
    template_to_hdf5,
    verify,
    write_pack,
)
from modalmotion.store.folder import Folder, ResultName
from modalmotion.store.record import read_record, record_to_json
from modalmotion.store.sealed import SEAL_LENGTH, seal
from modalmotion.template import make_template

N = 4


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A store with four sequences, their signatures and classifications, a job and a key."""
    folder = tmp_path / "store"
    with ResultStore(folder) as store:
        for number in range(N):
            sequence = sample_sequence(number)
            store.put_sequence(sequence, subject=f"P {number}", label="rest")
            store.put_signature(sample_signature(sequence))
            store.put_signature(sample_signature(sequence, modes=4))
            store.put_classification(sample_classification(sequence.id), KEY)
        store.update_sequence(sample_sequence(0).id, label=None)
        store.put_model(sample_model(1))
        store.jobs.create("signature", {"number": 1})
        store.idempotency.claim("key", "fingerprint")
    return folder


def index_of(root: Path) -> dict[str, list[tuple[object, ...]]]:
    connection = sqlite3.connect(root / "index.sqlite")
    try:
        return {
            table: connection.execute(f"SELECT * FROM {table} ORDER BY 1, 2, 3, 4").fetchall()  # noqa: S608
            for table in ("sequences", "results", "models", "jobs", "idempotency")
        }
    finally:
        connection.close()


def damage(path: Path, place: int | None = None) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2 if place is None else place] ^= 0x41
    path.write_bytes(content)


def test_a_rebuilt_index_is_the_old_one(root: Path) -> None:
    before, files = index_of(root), tree(root)
    seen: list[tuple[int, int]] = []
    found = rebuild(root, progress=lambda done, total: seen.append((done, total)))
    assert (found.n_sequences, found.n_results) == (N, 3 * N)
    assert (found.restored, found.damaged, found.orphans) == ((), (), ())
    assert not found.jobs_lost
    assert index_of(root) == before
    assert tree(root) == files
    assert seen == [(i + 1, 4 * N) for i in range(4 * N)]


def test_an_index_that_is_lost_comes_back_without_jobs(root: Path) -> None:
    before = index_of(root)
    (root / "index.sqlite").unlink()
    rebuild(root)
    after = index_of(root)
    for table in ("sequences", "results", "models"):
        assert after[table] == before[table]
    assert (after["jobs"], after["idempotency"]) == ([], [])


def test_a_lost_index_is_built_anew_by_opening_too(root: Path) -> None:
    before = index_of(root)
    (root / "index.sqlite").unlink()
    ResultStore(root).open().close()
    assert index_of(root)["sequences"] == before["sequences"]
    assert index_of(root)["results"] == before["results"]


@pytest.mark.parametrize("place", [0, 50, 99])
def test_a_damaged_index_is_built_anew_and_says_whether_jobs_are_lost(
    place: int, root: Path
) -> None:
    before = index_of(root)
    path = root / "index.sqlite"
    content = bytearray(path.read_bytes())
    start = len(content) * place // 100
    content[start : start + 4096] = b"\xa5" * 4096
    path.write_bytes(content)
    assert not verify(root).is_sound
    found = rebuild(root)
    after = index_of(root)
    assert (after["sequences"], after["results"]) == (before["sequences"], before["results"])
    assert found.jobs_lost is (after["jobs"] == [])
    assert verify(root).is_sound


def test_jobs_survive_a_damaged_index_where_they_can_be_read(root: Path) -> None:
    before = index_of(root)
    connection = sqlite3.connect(root / "index.sqlite")
    (page,) = connection.execute(
        "SELECT rootpage FROM sqlite_master WHERE name = 'sequences_by_label'"
    ).fetchone()
    connection.close()
    content = bytearray((root / "index.sqlite").read_bytes())
    content[(page - 1) * 4096 : page * 4096] = b"\xa5" * 4096
    (root / "index.sqlite").write_bytes(content)
    assert any(fault.file == "index.sqlite" for fault in verify(root).faults)
    assert not rebuild(root).jobs_lost
    assert index_of(root) == before


def test_a_damaged_record_is_written_anew_from_the_index(root: Path) -> None:
    folder, before = Folder(root), index_of(root)
    files = tree(root)
    path = folder.record(sample_sequence(1).id)
    damage(path)
    assert [fault.file for fault in verify(root).faults] == [folder.short(path)]
    assert rebuild(root).restored == (folder.short(path),)
    assert index_of(root) == before
    assert tree(root) == files


def test_a_damaged_record_without_an_index_comes_back_without_its_names(root: Path) -> None:
    folder, name = Folder(root), sample_sequence(1).id
    damage(folder.record(name))
    (root / "index.sqlite").unlink()
    assert rebuild(root).restored == (folder.short(folder.record(name)),)
    with ResultStore(root) as store:
        record = store.sequence_record(name)
        assert (record.subject, record.label, record.n_frames) == (None, None, 4)
        assert_same(store.sequence(name), sample_sequence(1))
        assert_same(store.signature(name, KEY), sample_signature(sample_sequence(1)))
    assert verify(root).is_sound


def test_a_record_with_a_flipped_byte_is_damaged_or_says_the_same(root: Path) -> None:
    path = Folder(root).record(sample_sequence(1).id)
    expected, content = read_record(path), path.read_bytes()
    n_damaged = 0
    places = range(0, len(content), 3)
    for place in places:
        damage(path, place)
        try:
            assert read_record(path) == expected
        except CorruptFileError:
            n_damaged += 1
        path.write_bytes(content)
    # The others lie in the white space between fields.
    assert n_damaged > 0.9 * len(places)


def test_damaged_results_are_left_where_they_are_and_named(root: Path) -> None:
    folder, sequence = Folder(root), sample_sequence(2)
    path = folder.result(ResultName("signature", sequence.id, "", KEY))
    damage(path)
    assert rebuild(root).damaged == (folder.short(path),)
    assert path.exists()
    assert [fault.file for fault in verify(root).faults] == [folder.short(path)]
    with ResultStore(root) as store:
        assert KEY not in store.signatures(sequence.id)
        store.put_signature(sample_signature(sequence))
        assert_same(store.signature(sequence.id, KEY), sample_signature(sequence))
    assert verify(root).is_sound


def test_a_damaged_upload_is_named_and_mended_by_sending_it_again(root: Path) -> None:
    folder, sequence = Folder(root), sample_sequence(1)
    _flip_upload(root)
    assert rebuild(root).damaged == (folder.short(folder.upload(sequence.id)),)
    with ResultStore(root) as store:
        assert store.sequence_record(sequence.id).subject == "P 1"
        with pytest.raises(CorruptFileError):
            store.sequence(sequence.id)
        assert not store.put_sequence(sequence)
        assert_same(store.sequence(sequence.id), sequence)
    assert verify(root).is_sound


def test_what_belongs_to_nothing_is_listed_and_left_alone(root: Path) -> None:
    folder = Folder(root)
    orphan = folder.result(ResultName("signature", "ab" * 32, "", KEY))
    orphan.parent.mkdir(exist_ok=True)
    with ResultStore(root) as store:
        orphan.write_bytes(store.signature_path(sample_sequence(1).id, KEY).read_bytes())
    foreign = [orphan.parent / "README", root / "notes.txt", root / "sequences" / "stray"]
    for path in foreign:
        path.write_text("mine")
    names = tuple(sorted(folder.short(path) for path in (orphan, *foreign)))
    assert rebuild(root).orphans == names
    # That file does not even hold what its name says, which is a fault of its own.
    report = verify(root)
    assert [fault.file for fault in report.faults] == [folder.short(orphan)]
    assert report.orphans == tuple(name for name in names if not name.endswith(".h5"))
    assert all(path.exists() for path in (orphan, *foreign))


def _flip_upload(root: Path) -> None:
    damage(Folder(root).upload(sample_sequence(1).id))


def _flip_template(root: Path) -> None:
    template = make_template(sample_sequence(1))
    path = Folder(root).template(template.id)
    path.parent.mkdir(parents=True)
    path.write_bytes(template_to_hdf5(template))
    assert verify(root).is_sound
    damage(path)


def _flip_signature(root: Path) -> None:
    damage(Folder(root).result(ResultName("signature", sample_sequence(1).id, "", KEY)))


def _flip_classification(root: Path) -> None:
    damage(Folder(root).result(ResultName("classification", sample_sequence(1).id, MODEL, KEY)))


def _cut(root: Path) -> None:
    path = Folder(root).upload(sample_sequence(1).id)
    path.write_bytes(path.read_bytes()[:-1])


def _remove_record(root: Path) -> None:
    Folder(root).record(sample_sequence(1).id).unlink()


def _remove_upload(root: Path) -> None:
    Folder(root).upload(sample_sequence(1).id).unlink()


def _remove_result(root: Path) -> None:
    Folder(root).result(ResultName("signature", sample_sequence(1).id, "", KEY)).unlink()


def _swap(root: Path) -> None:
    folder = Folder(root)
    a, b = (folder.upload(sample_sequence(number).id) for number in (1, 2))
    content = a.read_bytes()
    a.write_bytes(b.read_bytes())
    b.write_bytes(content)


def _another_record(root: Path) -> None:
    folder = Folder(root)
    a, b = (folder.record(sample_sequence(number).id) for number in (1, 2))
    a.write_bytes(b.read_bytes())


def _other_numbers(root: Path) -> None:
    # A sound signature of the same name, but not the one that was kept.
    sequence = sample_sequence(1)
    name = ResultName("signature", sequence.id, "", KEY)
    signature = sample_signature(sequence)
    with ResultStore(root.parent / "other") as other:
        other.put_sequence(sequence)
        path = other.put_signature(replace(signature, notes=("another",)))
    Folder(root).result(name).write_bytes(path.read_bytes())


def _other_vertices(root: Path) -> None:
    # Sealed and under the right id, which does not stand for these vertices.
    one, other = sample_sequence(1), sample_sequence(9)
    image = sequence_to_hdf5(other)[:-SEAL_LENGTH].replace(other.id.encode(), one.id.encode())
    Folder(root).upload(one.id).write_bytes(seal([image]))


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
    _flip_upload,
    _flip_template,
    _flip_signature,
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
    seen: list[tuple[int, int]] = []
    report = verify(root, progress=lambda done, total: seen.append((done, total)))
    assert (report.n_sequences, report.n_results) == (N, 3 * N)
    assert report.n_bytes == sum(map(len, tree(root).values()))
    assert seen[-1] == (5 * N + 1, 5 * N + 1)


@pytest.mark.parametrize("look", [rebuild, verify, lambda root: export(root, root / "out.h5")])
def test_a_folder_without_a_store_is_not_made_into_one(
    look: Callable[[Path], object], tmp_path: Path
) -> None:
    with pytest.raises(NotFoundError, match="holds no store"):
        look(tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("look", [rebuild, verify, lambda root: export(root, root / "out.h5")])
def test_a_store_that_is_open_is_left_alone(look: Callable[[Path], object], root: Path) -> None:
    with ResultStore(root), pytest.raises(StoreError, match="in use by process"):
        look(root)


def test_the_export_holds_every_trajectory_under_its_parameters(root: Path, tmp_path: Path) -> None:
    out = tmp_path / "all.h5"
    seen: list[tuple[int, int]] = []
    timed = mesh_sequence(
        sample_sequence(9, n_frames=3).vertices,
        grid=(5, 6),
        topology="cup",
        times=[0.0, 0.5, 0.75],
        unit="m",
    )
    with ResultStore(root) as store:
        store.put_sequence(timed, subject="Zoë")
        store.put_signature(modal_signature(timed))
    n_signatures = export(root, out, progress=lambda done, total: seen.append((done, total)))
    assert n_signatures == 2 * N + 1
    assert seen[-1] == (n_signatures, n_signatures)
    found = set()
    with ResultStore(root) as store, h5py.File(out, "r") as file:
        assert file.attrs["schema"] == "modalmotion.export"
        assert len(file) == 3
        for group in file.values():
            assert len({len(group[name]) for name in ("sequence_id", "n_frames", "label")}) == 1
            ends = np.cumsum(group["n_frames"])
            assert len(group["amplitudes"]) == ends[-1]
            for row, end in enumerate(ends):
                start = end - group["n_frames"][row]
                name = group["sequence_id"][row].decode()
                key = group.attrs["parameters_key"]
                signature = store.signature(name, key)
                found.add((name, key))
                frames = slice(start, end)
                np.testing.assert_array_equal(group["amplitudes"][frames], signature.amplitudes)
                np.testing.assert_array_equal(group["max_errors"][frames], signature.max_errors)
                np.testing.assert_array_equal(
                    group["times"][frames],
                    np.full(4, np.nan) if signature.times is None else signature.times,
                )
                assert isinstance(signature.modes, ModeSet)
                np.testing.assert_array_equal(group["wavenumbers"], signature.modes.wavenumbers)
                assert group["amplitudes"].attrs["unit"] == signature.unit
                record = store.sequence_record(name)
                assert group["subject"][row].decode() == record.subject
                assert group["label"][row].decode() == (record.label or "")
    assert len(found) == n_signatures


def test_a_pack_without_a_store_is_the_same_as_an_export(root: Path, tmp_path: Path) -> None:
    export(root, tmp_path / "one.h5")
    with ResultStore(root) as store:
        signatures = [
            (store.signature(*name), store.sequence_record(name[0]))
            for name in store.all_signatures()
        ]
    write_pack(tmp_path / "other.h5", iter(signatures))
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "other.h5").read_bytes()


def test_an_export_of_many_batches_is_the_same(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export(root, tmp_path / "one.h5")
    monkeypatch.setattr("modalmotion.store.analysis_file._BATCH", 3)
    export(root, tmp_path / "many.h5")
    with h5py.File(tmp_path / "one.h5", "r") as one, h5py.File(tmp_path / "many.h5", "r") as many:
        for name, group in one.items():
            for column, dataset in group.items():
                np.testing.assert_array_equal(dataset[:], many[name][column][:])


def test_an_export_that_fails_leaves_nothing_behind(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out.h5"
    out.write_text("mine")
    with pytest.raises(StoreError, match="exists already"):
        export(root, out)
    assert out.read_text() == "mine"
    out.unlink()

    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(StoreError):
            export(root, out)
    _flip_signature(root)
    with pytest.raises(CorruptFileError):
        export(root, out)
    with pytest.raises(StoreError):
        export(root, tmp_path / "missing" / "out.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["store"]


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(commands, arguments)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.output


def test_the_commands_say_what_they_found(root: Path, tmp_path: Path) -> None:
    code, text = run("verify", str(root))
    assert code == 0
    assert "4 sequences, 12 results" in text
    assert "sound" in text
    code, text = run("export", str(root), str(tmp_path / "out.h5"))
    assert code == 0
    assert "8 signatures" in text
    _flip_signature(root)
    code, text = run("verify", str(root))
    assert code == 1
    assert "1 fault\n" in text
    assert f"{sample_sequence(1).id}-{KEY}.h5" in text
    code, text = run("rebuild", str(root))
    assert code == 0
    assert "4 sequences, 11 results" in text
    assert f"{KEY}.h5: damaged" in text


def test_a_record_of_a_newer_version_is_not_overwritten(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, name = Folder(root), sample_sequence(1).id
    path = folder.record(name)
    with ResultStore(root) as store:
        record = store.sequence_record(name)
    with monkeypatch.context() as patch:
        patch.setattr("modalmotion.store.record.SCHEMA_VERSION", 2)
        patch.setattr("modalmotion.store.record.asdict", lambda _: {"unheard": "of"})
        newer = record_to_json(record)
    path.write_bytes(newer)
    assert [fault.file for fault in verify(root).faults] == [folder.short(path)]
    assert rebuild(root).damaged == (folder.short(path),)
    assert path.read_bytes() == newer


def documentation() -> str:
    return (Path(__file__).resolve().parents[2] / "docs" / "storage.md").read_text()


def test_the_documented_python_runs() -> None:
    blocks = re.findall(r"^```python\n(.*?)^```", documentation(), re.MULTILINE | re.DOTALL)
    assert blocks
    for block in blocks:
        exec(block, {})  # noqa: S102 (our own documentation)


def test_every_dataset_and_attribute_of_a_file_is_documented(root: Path, tmp_path: Path) -> None:
    template = tmp_path / "template.h5"
    template.write_bytes(template_to_hdf5(make_template(sample_sequence(1))))
    export(root, tmp_path / "out.h5")
    names: set[str] = set()
    for path in (template, tmp_path / "out.h5", *root.glob("*/*/*.h5")):
        with h5py.File(path, "r") as file:
            for group in (file, *(item for item in file.values() if isinstance(item, h5py.Group))):
                names |= set(group.attrs)
                names |= {name for name, item in group.items() if isinstance(item, h5py.Dataset)}
    text = documentation()
    assert not {name for name in names if f"`{name}`" not in text}
