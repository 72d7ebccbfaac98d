"""The commands on a service's data folder, where each owner has a store of their own."""

from __future__ import annotations

import re
import sqlite3
import stat
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from store_samples import sample_sequence, sample_signature

from modalmotion.cli.commands import main
from modalmotion.errors import StoreError
from modalmotion.exports.signature_pack import export
from modalmotion.store import ResultStore, backup


def run(*words: object) -> Result:
    return CliRunner().invoke(main, ["store", *map(str, words)])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    root = tmp_path / "results"
    for number, path in enumerate((root, root / "owners" / "lab", root / "owners" / "ward")):
        with ResultStore(path) as store:
            for seed in range(number + 1):
                store.put_sequence(sample_sequence(seed))
    return root


def test_all_owners_stores_are_verified_and_one_that_is_damaged_is_told(folder: Path) -> None:
    done = run("verify", folder)
    assert done.exit_code == 0
    assert re.findall(r"(\w+):\n.*yes\n *sequences *(\d)", done.stdout) == [
        *(("local", "1"), ("lab", "2"), ("ward", "3"))
    ]
    (damaged, *_) = (folder / "owners" / "lab").rglob("sequences/*/*.h5")
    damaged.write_bytes(damaged.read_bytes()[:-1])
    done = run("verify", folder)
    assert done.exit_code == 1
    assert re.findall(r"is sound *(yes|no)", done.stdout) == ["yes", "no", "yes"]
    # What is wrong is told with whose it is.
    told = done.stdout.partition("lab:")[2].partition("ward:")[0]
    assert f"sequences/{damaged.parent.name}/" in told
    assert run("verify", folder, "--owner", "ward").exit_code == 0
    assert run("verify", folder, "--owner", "lab").exit_code == 1
    assert "lab" not in run("verify", folder, "--owner", "local").stdout


def test_all_owners_indexes_are_built_anew(folder: Path) -> None:
    for index in folder.rglob("index.sqlite"):
        index.unlink()
    done = run("rebuild", folder)
    assert done.exit_code == 0
    assert re.search(r"ward:\n *sequences *3", done.stdout)
    for name, number in (("lab", 2), ("ward", 3)):
        with ResultStore(folder / "owners" / name) as store:
            assert len(store.list_sequences().records) == number


def test_a_backup_is_as_private_as_what_it_copies(folder: Path, tmp_path: Path) -> None:
    access = folder / "access"
    access.mkdir(mode=0o700)
    with sqlite3.connect(access / "keys.sqlite") as keys:
        keys.execute("CREATE TABLE keys (id)")
    keys.close()
    (access / "keys.sqlite").chmod(0o600)
    backup(folder, tmp_path / "copy")
    assert stat.S_IMODE((tmp_path / "copy").stat().st_mode) == 0o700
    copied = tmp_path / "copy" / "access" / "keys.sqlite"
    assert stat.S_IMODE(copied.stat().st_mode) == 0o600


class Killed(BaseException):
    pass


@pytest.mark.parametrize("n_copied", [0, 1, 2])
def test_a_first_backup_that_was_cut_short_is_gone_on_with(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, n_copied: int
) -> None:
    copy, real = tmp_path / "copy", sqlite3.connect
    # A connection for each database.
    left = iter(range(n_copied))

    def connect(path: Path) -> sqlite3.Connection:
        if next(left, None) is None:
            # As a kill leaves it: with what is unfinished beside its place.
            copy.mkdir(exist_ok=True)
            (copy / f".modalmotion-1-{0:016x}.tmp").touch()
            raise Killed
        return real(path)

    with monkeypatch.context() as cut:
        cut.setattr(sqlite3, "connect", connect)
        with pytest.raises(Killed):
            backup(folder, copy)
    report = backup(folder, copy)
    own = ("lock", "backup.json")
    files = [path for path in copy.rglob("*") if path.is_file() and path.name not in own]
    assert report.n_files == len(files)
    assert run("verify", copy).exit_code == 0


def test_nothing_is_overwritten_by_a_pack(folder: Path, tmp_path: Path) -> None:
    out, root = tmp_path / "all.h5", folder / "owners" / "lab"
    refused = run("export", folder, out)
    assert refused.exit_code == 1
    assert "--owner lab" in refused.stderr
    assert not out.exists()
    with ResultStore(root) as store:
        sequence = sample_sequence(0)
        store.put_signature(sample_signature(sequence))
    # The remedy, followed.
    assert run("export", folder, out, "--owner", "lab").exit_code == 0
    with pytest.raises(StoreError, match="exists already"):
        export(root, out)


def test_an_export_names_the_owners_and_leaves_nothing_that_stands_in_the_way(
    folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "all.h5"
    with ResultStore(folder / "owners" / "lab") as store:
        store.put_signature(sample_signature(sample_sequence(0)))
    (folder / "owners" / ".removed-old").mkdir()
    for wrong in ("nobody", ".removed-old", "../lab"):
        done = run("export", folder, out, "--owner", wrong)
        assert (done.exit_code, "local, lab, ward" in done.output) == (2, True)
        assert not out.exists()
    for empty in ((), ("--owner", "local"), ("--owner", "ward")):
        done = run("export", folder, out, *empty)
        assert (done.exit_code, "--owner lab" in done.output) == (1, True)
        assert not out.exists()
    assert re.search(r"signatures *1\n", run("export", folder, out, "--owner", "lab").output)
    with ResultStore(folder) as store:
        store.put_signature(sample_signature(sample_sequence(0)))
    done = run("export", folder, tmp_path / "local.h5")
    assert (done.exit_code, "not in it: --owner lab or ward" in done.output) == (0, True)
