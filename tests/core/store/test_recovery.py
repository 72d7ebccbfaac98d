"""Indexes and records that are lost or damaged, the commands, and the documentation."""

from __future__ import annotations

import os
import re
import sqlite3
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from damaged_stores import N, damage, flip_signature, flip_upload, four_kept
from project import ROOT
from sealed_files import changed
from service_table import STATEMENT
from store_samples import KEY, assert_same, sample_sequence, sample_signature, tree

from modalmotion.cli.store_commands import store as commands
from modalmotion.errors import CorruptFileError, NotFoundError
from modalmotion.exports.signature_pack import export
from modalmotion.progress import Progress
from modalmotion.store import ResultStore, rebuild, template_to_hdf5, verify
from modalmotion.store.folders import FORM, Folder, ResultName, read_record, record_values
from modalmotion.template import make_template


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return four_kept(tmp_path / "store")


def index_of(root: Path) -> dict[str, list[tuple[object, ...]]]:
    connection = sqlite3.connect(root / "index.sqlite")
    try:
        connection.execute(STATEMENT)
        return {
            table: connection.execute(f"SELECT * FROM {table} ORDER BY 1, 2").fetchall()  # noqa: S608
            for table in ("sequences", "results", "models", "visits")
        }
    finally:
        connection.close()


def test_a_rebuilt_index_is_the_old_one(root: Path) -> None:
    before, files = index_of(root), tree(root)
    seen: list[Progress] = []
    found = rebuild(root, progress=seen.append)
    assert (found.n_sequences, found.n_results) == (N, 3 * N)
    assert (found.restored, found.damaged, found.orphans) == ((), (), ())
    assert not found.service_tables_lost
    assert index_of(root) == before
    assert tree(root) == files
    assert seen == [Progress(i + 1, 5 * N + 1) for i in range(5 * N + 1)]


def test_files_of_another_version_are_left_alone_and_not_listed(root: Path) -> None:
    path = Folder(root).path("results", ResultName("signature", sample_sequence(1).id, "", KEY))

    def older(file: h5py.File) -> None:
        file.attrs["schema_version"] = np.int64(1)

    path.write_bytes(changed(path.read_bytes(), older))
    (root / "index.sqlite").unlink()
    before = tree(root)
    with ResultStore(root) as store, pytest.raises(NotFoundError):
        store.signature_path(sample_sequence(1).id, KEY)
    assert tree(root)[str(path.relative_to(root))] == before[str(path.relative_to(root))]
    assert rebuild(root).damaged == (Folder(root).short(path),)
    assert path.read_bytes() == before[str(path.relative_to(root))]


def test_an_index_that_is_lost_comes_back_without_tables_of_a_service(root: Path) -> None:
    before = index_of(root)
    (root / "index.sqlite").unlink()
    rebuild(root)
    assert index_of(root) == {**before, "visits": []}


def test_a_lost_index_is_built_anew_by_opening_too(root: Path) -> None:
    before = index_of(root)
    (root / "index.sqlite").unlink()
    ResultStore(root).open().close()
    assert index_of(root)["sequences"] == before["sequences"]
    assert index_of(root)["results"] == before["results"]


@pytest.mark.parametrize("place", [0, 50, 99])
def test_a_damaged_index_is_built_anew_and_says_whether_service_tables_are_lost(
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
    assert found.service_tables_lost is (after["visits"] == [])
    assert verify(root).is_sound


def test_service_tables_survive_a_damaged_index_where_they_can_be_read(root: Path) -> None:
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
    assert not rebuild(root).service_tables_lost
    assert index_of(root) == before


def test_a_damaged_record_is_written_anew_from_the_index(root: Path) -> None:
    folder, before = Folder(root), index_of(root)
    files = tree(root)
    path = folder.path("records", sample_sequence(1).id)
    damage(path)
    assert [fault.file for fault in verify(root).faults] == [folder.short(path)]
    assert rebuild(root).restored == (folder.short(path),)
    assert index_of(root) == before
    assert tree(root) == files


def test_a_damaged_record_without_an_index_comes_back_without_its_names(root: Path) -> None:
    folder, name = Folder(root), sample_sequence(1).id
    damage(folder.path("records", name))
    (root / "index.sqlite").unlink()
    assert rebuild(root).restored == (folder.short(folder.path("records", name)),)
    with ResultStore(root) as store:
        record = store.sequence_record(name)
        assert (record.subject, record.label, record.n_frames) == (None, None, 4)
        assert_same(store.sequence(name), sample_sequence(1))
        assert_same(store.signature(name, KEY), sample_signature(sample_sequence(1)))
    assert verify(root).is_sound


def test_a_record_with_a_flipped_byte_is_damaged_or_says_the_same(root: Path) -> None:
    path = Folder(root).path("records", sample_sequence(1).id)
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
    path = folder.path("results", ResultName("signature", sequence.id, "", KEY))
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
    flip_upload(root)
    assert rebuild(root).damaged == (folder.short(folder.path("uploads", sequence.id)),)
    with ResultStore(root) as store:
        assert store.sequence_record(sequence.id).subject == "P 1"
        with pytest.raises(CorruptFileError):
            store.sequence(sequence.id)
        assert not store.put_sequence(sequence)
        assert_same(store.sequence(sequence.id), sequence)
    assert verify(root).is_sound


def test_what_belongs_to_nothing_is_listed_and_left_alone(root: Path) -> None:
    folder = Folder(root)
    orphan = folder.path("results", ResultName("signature", "ab" * 32, "", KEY))
    orphan.parent.mkdir(exist_ok=True)
    with ResultStore(root) as store:
        orphan.write_bytes(store.signature_path(sample_sequence(1).id, KEY).read_bytes())
    foreign = [orphan.parent / "README", root / "notes.txt", root / "sequences" / "stray"]
    for path in foreign:
        path.write_text("mine")
    names = tuple(sorted(folder.short(path) for path in (orphan, *foreign)))
    assert rebuild(root).orphans == names
    # That file does not even hold what its name says, which is a fault too.
    report = verify(root)
    assert [fault.file for fault in report.faults] == [folder.short(orphan)]
    assert report.orphans == names
    assert all(path.exists() for path in (orphan, *foreign))


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(commands, arguments)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.output


def told(text: str, *names: str) -> list[str]:
    return [re.findall(rf"^ *{name} +(.*)$", text, re.MULTILINE)[0] for name in names]


def test_what_was_rendered_of_a_deleted_signature_does_not_take_the_new_one(root: Path) -> None:
    sequence = sample_sequence(1)
    path = Folder(root).path("results", ResultName("signature", sequence.id, "", KEY))
    rendered = path.with_suffix(".json")
    with ResultStore(root) as store:
        store.delete_signature(sequence.id, KEY)
        # As a kill between the two leaves it.
        rendered.write_bytes(b"{}")
        os.utime(rendered, (0.0, 0.0))
        store.put_signature(sample_signature(sequence))
    later = time.time() + 60.0
    os.utime(path, (later, later))
    rebuild(root)
    with ResultStore(root) as store:
        assert KEY in store.signatures(sequence.id)


def test_the_commands_say_what_they_found(root: Path, tmp_path: Path) -> None:
    code, text = run("verify", str(root))
    assert code == 0
    assert told(text, "is sound", "sequences", "results") == ["yes", "4", "12"]
    code, text = run("export", str(root), str(tmp_path / "out.h5"))
    assert code == 0
    assert told(text, "signatures") == ["8"]
    flip_signature(root)
    code, text = run("verify", str(root))
    assert code == 1
    assert told(text, "is sound") == ["no"]
    assert f"{sample_sequence(1).id}-{KEY}.h5" in text
    # What is left out is named with its reason.
    code, text = run("export", str(root), str(tmp_path / "rest.h5"))
    assert code == 1
    assert re.search(rf"{sample_sequence(1).id[:12]} +\S.*sha256", text)
    code, text = run("rebuild", str(root))
    assert code == 0
    assert told(text, "sequences", "results") == ["4", "11"]
    assert told(text, "damaged")[0].endswith(f"{KEY}.h5")


def test_a_record_of_a_newer_version_is_not_overwritten(root: Path) -> None:
    folder, name = Folder(root), sample_sequence(1).id
    path = folder.path("records", name)
    with ResultStore(root) as store:
        record = store.sequence_record(name)
    newer = replace(FORM, version=FORM.version + 1).write(
        {**record_values(record), "unheard": "of"}
    )
    path.write_bytes(newer)
    assert [fault.file for fault in verify(root).faults] == [folder.short(path)]
    assert rebuild(root).damaged == (folder.short(path),)
    assert path.read_bytes() == newer


def documentation() -> str:
    return (ROOT / "docs" / "storage.md").read_text()


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
    heads: set[str] = set()
    for path in (template, tmp_path / "out.h5", *root.glob("*/*/*.h5")):
        with h5py.File(path, "r") as file:
            schema = np.asarray(file.attrs["schema"]).astype(str)
            heads.add(f"`{schema}`, version {file.attrs['schema_version']}\n")
            for group in (file, *(item for item in file.values() if isinstance(item, h5py.Group))):
                names |= set(group.attrs)
                names |= {name for name, item in group.items() if isinstance(item, h5py.Dataset)}
    text = documentation()
    assert not {name for name in names if f"`{name}`" not in text}
    assert not {head for head in heads if head not in text}
