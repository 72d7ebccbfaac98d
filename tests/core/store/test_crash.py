from __future__ import annotations

import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from project import ROOT
from service_table import visits
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

from modalmotion.errors import NotFoundError
from modalmotion.store import ResultStore, verify
from modalmotion.store.folders import Folder

WRITER = ROOT / "tests" / "support" / "store_writer.py"
NUMBERS_A_ROUND = 1_000_000


def start(root: Path, first: int) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(WRITER), str(root), str(first)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def run_and_kill(writer: subprocess.Popen[str], rng: np.random.Generator) -> list[str]:
    """Lines that the writer wrote before it was killed, at a random moment of its work."""
    assert writer.stdin is not None
    assert writer.stdout is not None
    writer.stdin.write("begin\n")
    writer.stdin.flush()
    # By lines rather than by time alone, so that a busy machine tries the same moments.
    lines = [writer.stdout.readline() for _ in range(rng.integers(1, 100))]
    time.sleep(rng.uniform(0, 0.004))
    writer.kill()
    lines += writer.stdout.readlines()
    writer.wait()
    writer.stdin.close()
    writer.stdout.close()
    return [line for line in lines if line.endswith("\n")]


def check_round(store: ResultStore, lines: list[str], visitors: set[int]) -> set[str]:
    """Check everything that was acknowledged; give the ids that are there."""
    begun: defaultdict[int, set[str]] = defaultdict(set)
    acknowledged: defaultdict[int, set[str]] = defaultdict(set)
    for line in lines:
        sign, change, digits = line.split()
        (begun if sign == "+" else acknowledged)[int(digits)].add(change)
    there = set()
    for number, changes in begun.items():
        sequence, done = sample_sequence(number), acknowledged[number]
        assert "visit" not in done or number in visitors
        try:
            model = store.kept_model(f"m{number}", 1)
        except NotFoundError:
            assert "model" not in done or "delete-model" in changes
        else:
            assert "delete-model" not in done
            expected = sample_model(number).arrays["strangeness"]
            assert np.array_equal(model.arrays["strangeness"], expected)
        if not store.has_sequence(sequence.id):
            assert "put" not in done or "delete" in changes
            with pytest.raises(NotFoundError):
                store.signatures(sequence.id)
            assert not [name for name in tree(store.root) if sequence.id in name]
            continue
        assert "delete" not in done
        there.add(sequence.id)
        if "put" in done or store.sequence_record(sequence.id).has_upload:
            assert_same(store.sequence(sequence.id), sequence)
        else:
            assert not store.put_sequence(sequence)
            assert_same(store.sequence(sequence.id), sequence)
        subject = store.sequence_record(sequence.id).subject
        assert subject == "before" or "update" in changes
        assert subject == "after" or "update" not in done
        if store.signatures(sequence.id):
            assert_same(store.signature(sequence.id, KEY), sample_signature(sequence))
        else:
            assert "signature" not in done
        if store.classifications(sequence.id):
            found = store.classification(sequence.id, MODEL, KEY)
            assert_same(found, sample_classification(sequence.id))
        else:
            assert "classification" not in done
    return there


def kill_many_times(root: Path, n_rounds: int, rng: np.random.Generator) -> None:
    writers = [start(root, NUMBERS_A_ROUND * number) for number in range(2)]
    expected: set[str] = set()
    n_acknowledged = 0
    try:
        for number in range(n_rounds):
            lines = run_and_kill(writers.pop(0), rng)
            writers.append(start(root, NUMBERS_A_ROUND * (number + 2)))
            assert verify(root).faults == ()
            with ResultStore(root) as store:
                visitors = visits(store)
                expected |= check_round(store, lines, visitors)
                for record in store.list_sequences(limit=1000).records:
                    if record.id not in expected:
                        raise AssertionError("a sequence is there that nobody put")
                assert len(expected) == sum(1 for _ in root.glob("sequences/*/*.json"))
                # Keeps later rounds short; what they check is their own.
                for sequence_id in sorted(expected)[40:]:
                    store.delete_sequence(sequence_id)
                    expected.remove(sequence_id)
            report = verify(root)
            assert (report.faults, report.unfinished, report.orphans) == ((), (), ())
            assert report.n_sequences == len(expected)
            n_acknowledged += sum(line.startswith("=") for line in lines)
    finally:
        for writer in writers:
            writer.kill()
            writer.communicate()
    assert n_acknowledged > 5 * n_rounds


def test_a_killed_writer_loses_nothing_that_was_acknowledged(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    kill_many_times(tmp_path / "store", 2, rng)


@pytest.mark.soak
def test_sixty_killed_writers_lose_nothing_that_was_acknowledged(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    kill_many_times(tmp_path / "store", 60, rng)


def opened_again(root: Path) -> set[str]:
    """Ids after a crash: the folder as it is, and nobody who closed the store."""
    with ResultStore(root) as store:
        return {record.id for record in store.list_sequences().records}


@pytest.fixture
def crashed(tmp_path: Path) -> Path:
    """A store with one sequence and signature that was never closed."""
    store = ResultStore(tmp_path).open()
    store.put_sequence(sample_sequence(1), subject="P 1")
    store.put_signature(sample_signature(sample_sequence(1)))
    store._is_clean = False
    store.close()
    return tmp_path


def test_only_unfinished_files_of_ours_are_removed_after_a_crash(crashed: Path) -> None:
    shard = next((crashed / "signatures").iterdir())
    ours = [
        shard / ".modalmotion-123-0123456789abcdef.tmp",
        crashed / "sequences" / shard.name / ".modalmotion-1-ffffffffffffffff.tmp",
    ]
    others = [
        shard / ".modalmotion-123-0123456789abcdeg.tmp",
        shard / "notes.tmp",
        crashed / ".modalmotion-123-0123456789abcdef.tmp.keep",
        crashed / "mine.txt",
    ]
    for path in (*ours, *others):
        path.write_bytes(b"half")
    assert len(verify(crashed).unfinished) == 2
    opened_again(crashed)
    assert not [path for path in ours if path.exists()]
    assert all(path.read_bytes() == b"half" for path in others)
    assert len(verify(crashed).orphans) == 4


def test_a_file_that_the_index_does_not_know_yet_is_found_after_a_crash(
    crashed: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    # As when the process dies between the file and the index: taken from a store that lived.
    other = tmp_path_factory.mktemp("other")
    sequence = sample_sequence(2)
    with ResultStore(other) as store:
        store.put_sequence(sequence, subject="P 2")
        store.put_signature(sample_signature(sequence))
    for name, content in tree(other).items():
        (crashed / name).parent.mkdir(parents=True, exist_ok=True)
        (crashed / name).write_bytes(content)
    report = verify(crashed)
    assert report.is_sound
    assert len(report.unfinished) == 2
    with ResultStore(crashed) as store:
        assert store.sequence_record(sequence.id).subject == "P 2"
        assert_same(store.signature(sequence.id, KEY), sample_signature(sequence))
    assert verify(crashed).unfinished == ()


def test_vertices_without_a_record_get_one_after_a_crash(crashed: Path) -> None:
    folder = Folder(crashed)
    folder.path("records", sample_sequence(1).id).unlink()
    assert not verify(crashed).is_sound
    with ResultStore(crashed) as store:
        assert store.sequence_record(sample_sequence(1).id).subject == "P 1"
    assert verify(crashed).is_sound


def test_a_record_without_vertices_keeps_the_subject_for_a_second_put(crashed: Path) -> None:
    # As when the process dies between the record and the vertices.
    sequence = sample_sequence(1)
    folder = Folder(crashed)
    folder.path("uploads", sequence.id).unlink()
    assert verify(crashed).unfinished == (folder.short(folder.path("records", sequence.id)),)
    with ResultStore(crashed) as store:
        with pytest.raises(NotFoundError, match="not kept"):
            store.sequence(sequence.id)
        assert not store.put_sequence(sequence, subject="another")
        assert_same(store.sequence(sequence.id), sequence)
        assert store.sequence_record(sequence.id).subject == "P 1"
    assert verify(crashed).is_sound


def test_a_label_that_the_index_does_not_know_yet_is_the_one_after_a_crash(crashed: Path) -> None:
    folder, name = Folder(crashed), sample_sequence(1).id
    old = folder.path("records", name).read_bytes()
    with ResultStore(crashed) as store:
        store.update_sequence(name, label="new")
        store._is_clean = False
    new = folder.path("records", name).read_bytes()
    folder.path("records", name).write_bytes(old)
    assert verify(crashed).unfinished == (folder.short(folder.path("records", name)),)
    with ResultStore(crashed) as store:
        assert store.list_sequences().records[0].label is None
        store._is_clean = False
    folder.path("records", name).write_bytes(new)
    with ResultStore(crashed) as store:
        assert store.list_sequences(label="new").records[0].id == name


@pytest.mark.parametrize("n_removed", range(3))
def test_a_deletion_that_was_begun_is_finished_after_a_crash(n_removed: int, crashed: Path) -> None:
    folder, name = Folder(crashed), sample_sequence(1).id
    folder.path("records", name).rename(folder.path("deletions", name))
    for path in [folder.path("uploads", name), *folder.derived(name)][:n_removed]:
        path.unlink()
    assert verify(crashed).is_sound
    assert opened_again(crashed) == set()
    assert tree(crashed) == {}
    assert verify(crashed).unfinished == ()


def test_a_store_that_was_closed_in_order_is_not_searched(
    crashed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened_again(crashed)

    def no_scan(folder: Folder) -> None:
        raise AssertionError("the folder was searched")

    monkeypatch.setattr(Folder, "scan", no_scan)
    assert opened_again(crashed) == {sample_sequence(1).id}
