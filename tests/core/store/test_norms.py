"""Norms in a store: kept under a name, copied, checked, deleted for good."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from norm_controls import drawn, norm_of

from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.norm import Norm, norm_to_hdf5
from modalmotion.store import ResultStore, backup, rebuild, restore, verify


def a_norm(seed: int, name: str = "volunteers") -> Norm:
    rng = np.random.default_rng(seed)
    readings = [replace(drawn(rng, k), sequence_id=f"{seed}-{k}") for k in range(9)]
    return replace(norm_of(readings), name=name)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    with ResultStore(tmp_path / "store") as store:
        assert store.put_norm(a_norm(1))
        assert not store.put_norm(a_norm(1))
    return tmp_path / "store"


def test_a_name_is_one_norms_until_it_is_deleted(root: Path, tmp_path: Path) -> None:
    image = tmp_path / "image.h5"
    image.write_bytes(norm_to_hdf5(a_norm(2)))
    with ResultStore(root) as store:
        assert store.norms() == ("volunteers",)
        assert store.norm("volunteers").id == a_norm(1).id
        with pytest.raises(ParameterError, match="another norm named 'volunteers'"):
            store.put_norm_image(image)
        store.delete_norm("volunteers")
        with pytest.raises(NotFoundError, match="no norm named 'volunteers'"):
            store.delete_norm("volunteers")
        assert store.put_norm_image(image).id == a_norm(2).id
        for name in ("other", "../volunteers", "", "Volunteers"):
            with pytest.raises(NotFoundError):
                store.norm(name)
        with pytest.raises(ParameterError):
            store.put_norm(a_norm(1, "Not A Name"))
    assert verify(root).is_sound


def test_a_damaged_norm_is_found_and_put_again(root: Path) -> None:
    path = root / "norms" / "volunteers.h5"
    whole = path.read_bytes()
    path.write_bytes(whole[:-9])
    assert [fault.file for fault in verify(root).faults] == ["norms/volunteers.h5"]
    with ResultStore(root) as store:
        assert store.put_norm(a_norm(1))
    path.rename(path.with_stem("renamed"))
    (fault,) = verify(root).faults
    assert "another name" in fault.problem
    (root / "norms" / "notes.txt").write_text("mine")
    assert "norms/notes.txt" in verify(root).orphans


def test_a_copy_has_norms_and_learns_of_their_deletion(root: Path, tmp_path: Path) -> None:
    copy, older = tmp_path / "copy", tmp_path / "older"
    backup(root, copy)
    shutil.copytree(copy / "norms", older)
    with ResultStore(root) as store:
        store.delete_norm("volunteers")
    assert backup(root, copy).missing == ()
    assert not (copy / "norms" / "volunteers.h5").exists()
    # Older files that are laid over the folder bring nothing back.
    shutil.copytree(older, root / "norms", dirs_exist_ok=True)
    rebuild(root)
    with ResultStore(root) as store:
        assert store.norms() == ()
        store.put_norm(a_norm(3))
    backup(root, copy)
    (root / "norms" / "volunteers.h5").unlink()
    assert backup(root, copy).missing == ("norms/volunteers.h5",)
    shutil.rmtree(root)
    restore(copy, root)
    with ResultStore(root) as store:
        assert store.norm("volunteers").id == a_norm(3).id
