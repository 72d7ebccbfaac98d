"""Every trajectory of a store in one file."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from damaged_stores import N, damage, flip_signature, four_kept
from small_disk import small_disk
from store_samples import sample_sequence

from modalmotion.errors import CorruptFileError, NotFoundError, StoreError
from modalmotion.exports.signature_pack import export, write_pack
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes import ModeSet
from modalmotion.progress import Progress
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import ResultStore


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return four_kept(tmp_path / "store")


def test_the_export_holds_every_trajectory_under_its_parameters(root: Path, tmp_path: Path) -> None:
    out = tmp_path / "all.h5"
    seen: list[Progress] = []
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
    report = export(root, out, progress=seen.append)
    n_signatures = report.n_signatures
    assert (n_signatures, report.failures) == (2 * N + 1, ())
    assert seen[-1] == Progress(n_signatures, n_signatures)
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
    assert contents(tmp_path / "one.h5") == contents(tmp_path / "other.h5")


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
    with pytest.raises(StoreError):
        export(root, tmp_path / "missing" / "out.h5")
    assert [path.name for path in tmp_path.iterdir()] == ["store"]


def test_spring_modes_are_packed_beside_modes_in_closed_form(root: Path, tmp_path: Path) -> None:
    spider = spring_sequence()
    fitted = modal_signature(spider, SignatureParameters(modes=3))
    assert fitted.modes.topology is None
    with ResultStore(root) as store:
        store.put_sequence(spider)
        store.put_signature(fitted)
        alone = [(fitted, store.sequence_record(spider.id))]
    assert export(root, tmp_path / "all.h5").n_signatures == 2 * N + 1
    write_pack(tmp_path / "alone.h5", alone)
    for path in (tmp_path / "all.h5", tmp_path / "alone.h5"):
        with h5py.File(path, "r") as file:
            (group,) = [group for group in file.values() if group.attrs["topology"] == "mesh"]
            np.testing.assert_array_equal(group["amplitudes"], fitted.amplitudes)
            np.testing.assert_array_equal(
                group["spring_eigenvalues"], fitted.modes.arrays["spring_eigenvalues"]
            )
            assert group["lengths"].shape == (1, 0)


def test_a_damaged_signature_costs_only_itself(root: Path, tmp_path: Path) -> None:
    flip_signature(root)
    report = export(root, tmp_path / "out.h5")
    assert report.n_signatures == 2 * N - 1
    ((sequence_id, reason),) = report.failures
    assert sequence_id == sample_sequence(1).id
    assert reason
    with h5py.File(tmp_path / "out.h5", "r") as file:
        assert sum(len(group["sequence_id"]) for group in file.values()) == 2 * N - 1


def test_an_export_without_a_sound_signature_writes_nothing(root: Path, tmp_path: Path) -> None:
    for path in root.rglob("signatures/*/*.h5"):
        damage(path)
    with pytest.raises(CorruptFileError, match=f"None of {2 * N} signatures"):
        export(root, tmp_path / "out.h5")
    with ResultStore(tmp_path / "empty"):
        pass
    with pytest.raises(NotFoundError, match="has no signatures"):
        export(tmp_path / "empty", tmp_path / "out.h5")
    assert not (tmp_path / "out.h5").exists()


def contents(path: Path) -> dict[str, object]:
    """Give every attribute and dataset of a file by its path."""
    found: dict[str, object] = {}

    def take(name: str, node: h5py.Group | h5py.Dataset) -> None:
        found.update(
            {f"{name}@{key}": np.asarray(value).tolist() for key, value in node.attrs.items()}
        )
        if isinstance(node, h5py.Dataset):
            found[name] = (str(node.dtype), node.shape, repr(node[()].tolist()))

    with h5py.File(path, "r") as file:
        take("", file)
        file.visititems(take)
    return found


def spring_sequence() -> MeshSequence:
    """Three fins along one edge: a mesh without natural coordinates."""
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]], dtype=float)
    motion = np.random.default_rng(5).normal(scale=0.1, size=(3, 5, 3))
    faces = [[0, 1, 2], [0, 1, 3], [0, 1, 4]]
    return mesh_sequence(vertices + motion, faces, unit="mm")


def test_a_disk_that_fills_up_leaves_no_pack(root: Path, tmp_path: Path) -> None:
    with ResultStore(root) as store:
        names = store.all_signatures()
        pairs = [(store.signature(*name), store.sequence_record(name[0])) for name in names]
    write_pack(tmp_path / "whole.h5", pairs)
    size = (tmp_path / "whole.h5").stat().st_size
    with small_disk(tmp_path / "disk", f"{size // 2}") as disk:
        with pytest.raises(StoreError, match="No space left"):
            write_pack(disk.folder / "pack.h5", pairs)
        assert list(disk.folder.iterdir()) == []
