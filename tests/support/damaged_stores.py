"""A store of four sequences, and damage to its files."""

from __future__ import annotations

from pathlib import Path

from service_table import visit
from store_samples import (
    KEY,
    put_classification,
    sample_classification,
    sample_model,
    sample_sequence,
    sample_signature,
)

from modalmotion.store import ResultStore
from modalmotion.store.folders import Folder, ResultName

N = 4


def four_kept(folder: Path) -> Path:
    """A store with four sequences, their signatures and classes, and a table of the service."""
    with ResultStore(folder) as store:
        for number in range(N):
            sequence = sample_sequence(number)
            store.put_sequence(sequence, subject=f"P {number}", label="rest")
            store.put_signature(sample_signature(sequence))
            store.put_signature(sample_signature(sequence, modes=4))
            put_classification(store, sample_classification(sequence.id), KEY)
        store.update_sequence(sample_sequence(0).id, label=None)
        store.put_model(sample_model(1))
        visit(store, 1)
    return folder


def damage(path: Path, place: int | None = None) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2 if place is None else place] ^= 0x41
    path.write_bytes(content)


def flip_upload(root: Path) -> None:
    damage(Folder(root).path("uploads", sample_sequence(1).id))


def flip_signature(root: Path) -> None:
    damage(Folder(root).path("results", ResultName("signature", sample_sequence(1).id, "", KEY)))
