"""A store and other processes and threads."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
from store_samples import KEY, all_pages, assert_same, sample_sequence, sample_signature, tree

from modalmotion.errors import CorruptFileError, ModalMotionError, NotFoundError, StoreError
from modalmotion.store import ResultStore, record_of, sequence_to_hdf5, signature_to_hdf5, verify


@pytest.fixture
def store(tmp_path: Path) -> Iterator[ResultStore]:
    with ResultStore(tmp_path / "store") as opened:
        yield opened
    assert verify(tmp_path / "store").is_sound


def test_what_another_process_wrote_is_kept_as_it_is(store: ResultStore, tmp_path: Path) -> None:
    sequence = sample_sequence(1)
    signature = sample_signature(sequence)
    image = tmp_path / "image.h5"
    image.write_bytes(sequence_to_hdf5(sequence))
    record = record_of(sequence, created="", has_upload=True)
    kept, is_new = store.put_sequence_image(image, record, subject="P 1")
    assert is_new
    assert kept == store.sequence_record(sequence.id)
    assert kept.subject == "P 1"
    assert kept.created
    assert store.put_sequence_image(image, record, subject="P 2") == (kept, False)
    assert store.sequence_path(sequence.id).read_bytes() == image.read_bytes()
    assert_same(store.sequence(sequence.id), sequence)
    image.write_bytes(signature_to_hdf5(signature))
    path = store.put_signature_image(image, sequence.id, KEY)
    assert path.read_bytes() == image.read_bytes()
    assert_same(store.signature(sequence.id, KEY), signature)


def test_an_image_of_another_process_that_is_damaged_is_refused(
    store: ResultStore, tmp_path: Path
) -> None:
    sequence = sample_sequence(1)
    image = tmp_path / "image.h5"
    image.write_bytes(sequence_to_hdf5(sequence)[:-1])
    record = record_of(sequence, created="", has_upload=True)
    with pytest.raises(CorruptFileError):
        store.put_sequence_image(image, record)
    with pytest.raises(NotFoundError):
        store.put_sequence_image(image, replace(record, id="../../x"))
    assert tree(store.root) == {}
    store.put_sequence(sequence)
    before = tree(store.root)
    with pytest.raises(CorruptFileError):
        store.put_signature_image(image, sequence.id, KEY)
    with pytest.raises(StoreError, match="digests"):
        store.put_signature_image(store.sequence_path(sequence.id), sequence.id, "../../x")
    assert tree(store.root) == before


def test_a_second_store_on_the_folder_is_refused_by_the_process_that_has_it(
    tmp_path: Path,
) -> None:
    with ResultStore(tmp_path) as store:
        with pytest.raises(StoreError, match=f"process {os.getpid()}") as caught:
            ResultStore(tmp_path).open()
        assert caught.value.details == {"pid": os.getpid()}
        assert caught.value.remedy
        code = (
            "import sys; from pathlib import Path\n"
            "from modalmotion.store import ResultStore\n"
            "ResultStore(Path(sys.argv[1])).open()"
        )
        other = subprocess.run(
            [sys.executable, "-c", code, str(tmp_path)],
            capture_output=True,
            text=True,
            check=False,
        )
        assert other.returncode == 1
        assert f"in use by process {os.getpid()}" in other.stderr
        store.put_sequence(sample_sequence(1))
    ResultStore(tmp_path).open().close()


def test_a_forked_child_has_no_part_in_the_store_and_does_not_keep_its_lock(
    tmp_path: Path,
) -> None:
    # In another program, for forking this one with its threads would warn.
    code = """
import os, sys, time
from pathlib import Path
from modalmotion.errors import StoreError
from modalmotion.store import ResultStore

store = ResultStore(Path(sys.argv[1])).open()
child = os.fork()
if child == 0:
    try:
        store.list_sequences()
    except StoreError:
        os.write(1, f"{os.getpid()}\\n".encode())
    store.close()
time.sleep(60)
"""
    parent = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    try:
        with pytest.raises(StoreError, match=f"process {parent.pid}"):
            ResultStore(tmp_path).open()
        parent.kill()
        parent.wait()
        with ResultStore(tmp_path) as store:
            store.put_sequence(sample_sequence(1))
    finally:
        os.kill(child, signal.SIGKILL)
        parent.kill()
        parent.communicate()


def test_many_threads_put_list_and_delete_at_once(tmp_path: Path) -> None:
    sequences = [sample_sequence(number) for number in range(24)]
    signatures = [sample_signature(sequence) for sequence in sequences]
    doomed = set(range(0, 24, 3))
    deleted: set[int] = set()
    with ResultStore(tmp_path) as store:

        def put(number: int) -> bool:
            is_new = store.put_sequence(sequences[number % 24], subject=str(number % 24))
            if number % 24 in doomed:
                return is_new
            store.put_signature(signatures[number % 24])
            assert_same(store.signature(sequences[number % 24].id, KEY), signatures[number % 24])
            return is_new

        stop = threading.Event()

        def keep_listing() -> int:
            n_lists = 0
            while not stop.is_set():
                names = all_pages(store, 5)
                assert len(set(names)) == len(names)
                n_lists += 1
            return n_lists

        def delete(number: int) -> None:
            while True:
                try:
                    store.delete_sequence(sequences[number].id)
                except NotFoundError:
                    time.sleep(0.001)
                else:
                    deleted.add(number)
                    return

        with ThreadPoolExecutor(12) as pool:
            lister = pool.submit(keep_listing)
            deletions = [pool.submit(delete, number) for number in doomed]
            news = [pool.submit(put, number) for number in range(24)]
            again = [pool.submit(put, number) for number in range(24) if number not in doomed]
            assert all(new.result() for new in (news[number] for number in doomed))
            n_new = sum(new.result() for new in news) + sum(new.result() for new in again)
            assert n_new == 24
            for deletion in deletions:
                deletion.result()
            stop.set()
            assert lister.result() > 0
        assert deleted == doomed
        assert set(all_pages(store, 100)) == {
            sequence.id for number, sequence in enumerate(sequences) if number not in doomed
        }
    assert verify(tmp_path).is_sound
    assert len(tree(tmp_path)) == 16 * 3


def test_reading_during_a_deletion_gives_the_whole_or_says_it_is_gone(tmp_path: Path) -> None:
    sequence = sample_sequence(1)
    signature = sample_signature(sequence)
    with ResultStore(tmp_path) as store:
        stop = threading.Event()

        def read() -> tuple[int, int]:
            whole = gone = 0
            while not stop.is_set():
                try:
                    assert_same(store.signature(sequence.id, KEY), signature)
                    whole += 1
                except NotFoundError:
                    gone += 1
            return whole, gone

        with ThreadPoolExecutor(2) as pool:
            readers = [pool.submit(read) for _ in range(2)]
            for _ in range(6):
                store.put_sequence(sequence)
                store.put_signature(signature)
                store.delete_sequence(sequence.id)
            stop.set()
            counts = [reader.result() for reader in readers]
        assert sum(gone for _, gone in counts) > 0


def test_closing_waits_for_changes_and_refuses_later_ones(tmp_path: Path) -> None:
    store = ResultStore(tmp_path).open()
    sequences = [sample_sequence(number) for number in range(60)]
    acknowledged: list[str] = []

    def put() -> ModalMotionError | None:
        for sequence in sequences:
            try:
                store.put_sequence(sequence)
            except StoreError as error:
                return error
            acknowledged.append(sequence.id)
        return None

    with ThreadPoolExecutor(1) as pool:
        putting = pool.submit(put)
        while not acknowledged:
            time.sleep(0.001)
        store.close()
        error = putting.result()
    assert error is None or "not open" in error.message
    assert verify(tmp_path).is_sound
    with ResultStore(tmp_path) as again:
        assert {record.id for record in again.list_sequences().records} == set(acknowledged)
