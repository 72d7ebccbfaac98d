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

import numpy as np
import pytest
from store_samples import (
    KEY,
    MODEL,
    assert_same,
    sample_classification,
    sample_sequence,
    sample_signature,
    tree,
)

from modalmotion.errors import (
    CorruptFileError,
    ModalMotionError,
    NotFoundError,
    ParameterError,
    StoreError,
)
from modalmotion.sequence import mesh_sequence
from modalmotion.signature import SignatureParameters, modal_signature
from modalmotion.store import (
    UNSET,
    ResultStore,
    SequencePage,
    record_of,
    sequence_to_hdf5,
    signature_to_hdf5,
    template_from_hdf5,
    template_to_hdf5,
    verify,
)
from modalmotion.template import make_template


@pytest.fixture
def store(tmp_path: Path) -> Iterator[ResultStore]:
    with ResultStore(tmp_path / "store") as opened:
        yield opened
    assert verify(tmp_path / "store").is_sound


def test_making_a_store_touches_no_file_and_opening_makes_the_folder(tmp_path: Path) -> None:
    root = tmp_path / "deep" / "store"
    store = ResultStore(root)
    assert not root.parent.exists()
    with pytest.raises(StoreError, match="not open"):
        store.list_sequences()
    with store:
        assert root.is_dir()
        with pytest.raises(StoreError, match="open already"):
            store.open()
    with pytest.raises(StoreError, match="not open"):
        store.put_sequence(sample_sequence(1))


def test_what_is_put_comes_back_bit_for_bit_now_and_after_opening_again(tmp_path: Path) -> None:
    sequence = sample_sequence(1)
    signature = sample_signature(sequence)
    classification = sample_classification(sequence.id)
    with ResultStore(tmp_path) as store:
        assert store.put_sequence(sequence, subject="P 1", label="rest")
        path = store.put_signature(signature)
        assert path == store.signature_path(sequence.id, KEY)
        other = store.put_classification(classification, KEY)
        assert other == store.classification_path(sequence.id, MODEL, KEY)
    for _ in range(2):
        with ResultStore(tmp_path) as store:
            assert store.has_sequence(sequence.id)
            assert_same(store.sequence(sequence.id), sequence)
            assert_same(store.signature(sequence.id, KEY), signature)
            assert_same(store.classification(sequence.id, MODEL, KEY), classification)
            assert store.signatures(sequence.id) == (KEY,)
            assert store.classifications(sequence.id) == ((MODEL, KEY),)
            record = store.sequence_record(sequence.id)
            assert (record.n_frames, record.n_vertices, record.n_faces) == (4, 30, 0)
            assert (record.topology, record.grid, record.unit) == ("cup", (5, 6), "mm")
            assert (record.subject, record.label) == ("P 1", "rest")
            assert record.has_upload
            assert not record.has_times


def test_a_sequence_without_anything_optional_has_a_record_too(store: ResultStore) -> None:
    sequence = mesh_sequence(np.zeros((1, 3, 3)), [[0, 1, 2]])
    assert store.put_sequence(sequence)
    record = store.sequence_record(sequence.id)
    assert (record.topology, record.grid, record.unit) == (None, None, None)
    assert (record.subject, record.label) == (None, None)
    assert_same(store.sequence(sequence.id), sequence)


def test_what_is_known_is_not_written_again(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    assert store.put_sequence(sequence, subject="first")
    path = store.put_signature(sample_signature(sequence))
    before = path.stat().st_ino, store.sequence_record(sequence.id), tree(store.root)
    assert not store.put_sequence(sequence, subject="second")
    assert store.put_signature(sample_signature(sequence)) == path
    assert (path.stat().st_ino, store.sequence_record(sequence.id), tree(store.root)) == before


def test_each_choice_of_parameters_and_model_has_a_file_of_its_own(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    keys = set()
    for modes in (1, 4, 7):
        for reference in (0, 1):
            parameters = SignatureParameters(modes=modes, reference=reference)
            store.put_signature(modal_signature(sequence, parameters))
            keys.add(parameters.key)
            for model in ("a" * 64, "b" * 64):
                store.put_classification(sample_classification(sequence.id, model), parameters.key)
    assert set(store.signatures(sequence.id)) == keys
    expected = {(model, key) for model in ("a" * 64, "b" * 64) for key in keys}
    assert set(store.classifications(sequence.id)) == expected
    assert len(tree(store.root)) == 2 + 6 + 12


def test_a_damaged_file_is_named_and_healed_by_putting_it_again(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    signature = sample_signature(sequence)
    store.put_sequence(sequence)
    path = store.put_signature(signature)
    upload = next(store.root.glob(f"sequences/*/{sequence.id}.h5"))
    for broken in (path, upload):
        content = bytearray(broken.read_bytes())
        content[len(content) // 2] ^= 4
        broken.write_bytes(content)
    with pytest.raises(CorruptFileError, match=path.name):
        store.signature(sequence.id, KEY)
    with pytest.raises(CorruptFileError, match=upload.name):
        store.sequence(sequence.id)
    store.put_signature(signature)
    assert not store.put_sequence(sequence)
    assert_same(store.signature(sequence.id, KEY), signature)
    assert_same(store.sequence(sequence.id), sequence)


def test_a_file_under_another_name_is_not_taken_for_it(store: ResultStore) -> None:
    one, other = sample_sequence(1), sample_sequence(2)
    for sequence in (one, other):
        store.put_sequence(sequence)
        store.put_signature(sample_signature(sequence))
        store.put_classification(sample_classification(sequence.id), KEY)
    # Sound files, but each in the place of the other.
    for kind, read in (
        ("signatures", lambda: store.signature(one.id, KEY)),
        ("classifications", lambda: store.classification(one.id, MODEL, KEY)),
        ("sequences", lambda: store.sequence(one.id)),
    ):
        a = next(store.root.glob(f"{kind}/*/{one.id}*.h5"))
        b = next(store.root.glob(f"{kind}/*/{other.id}*.h5"))
        a_content, b_content = a.read_bytes(), b.read_bytes()
        a.write_bytes(b_content)
        with pytest.raises(CorruptFileError, match="another sequence id"):
            read()
        a.write_bytes(a_content)


def test_a_missing_file_is_no_unknown_id(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    path = store.put_signature(sample_signature(sequence))
    path.unlink()
    with pytest.raises(CorruptFileError, match="missing"):
        store.signature(sequence.id, KEY)
    store.put_signature(sample_signature(sequence))
    store.signature(sequence.id, KEY)


BAD_IDS = [
    "",
    "a" * 63,
    "a" * 65,
    "A" * 64,
    "g" * 64,
    "a" * 64 + "\n",
    "../" * 21 + "a",
    "a" * 60 + "/../",
    "\x00" * 64,
    "٣" * 64,
    "0" * 64,
]


@pytest.mark.parametrize("bad", BAD_IDS)
def test_an_id_that_is_none_never_reaches_the_files(
    bad: str, store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    store.put_signature(sample_signature(sequence))

    def no_file(*args: object, **options: object) -> None:
        raise AssertionError("a file was touched")

    with monkeypatch.context() as patch:
        for name in ("open", "stat", "unlink", "mkdir", "scandir"):
            patch.setattr(os, name, no_file)
        assert not store.has_sequence(bad)
        for call in (
            lambda: store.sequence(bad),
            lambda: store.sequence_record(bad),
            lambda: store.update_sequence(bad, label="x"),
            lambda: store.delete_sequence(bad),
            lambda: store.signatures(bad),
            lambda: store.classifications(bad),
            lambda: store.signature(bad, KEY),
            lambda: store.signature_path(bad, KEY),
            lambda: store.classification(bad, MODEL, KEY),
            lambda: store.signature(sequence.id, bad),
            lambda: store.signature_path(sequence.id, bad),
            lambda: store.classification(sequence.id, bad, KEY),
            lambda: store.classification(sequence.id, MODEL, bad),
        ):
            with pytest.raises(NotFoundError) as caught:
                call()
            assert caught.value.remedy


def test_results_of_an_unknown_sequence_are_refused(store: ResultStore) -> None:
    signature = sample_signature(sample_sequence(1))
    with pytest.raises(NotFoundError):
        store.put_signature(signature)
    with pytest.raises(NotFoundError):
        store.put_signature(replace(signature, sequence_id="../../etc"))
    with pytest.raises(NotFoundError):
        store.put_classification(sample_classification("0" * 64), KEY)
    assert tree(store.root) == {}


@pytest.mark.parametrize(("model", "key"), [("../x", KEY), (MODEL, "../x"), (MODEL, "")])
def test_a_classification_under_no_digest_is_refused(
    model: str, key: str, store: ResultStore
) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence)
    with pytest.raises(StoreError, match="digests"):
        store.put_classification(sample_classification(sequence.id, model), key)


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


def test_a_template_is_kept_once_and_found_by_its_id(store: ResultStore, tmp_path: Path) -> None:
    template = make_template(sample_sequence(1))
    image = tmp_path / "image.h5"
    image.write_bytes(template_to_hdf5(template))
    assert store.put_template_image(image, template.id)
    assert not store.put_template_image(image, template.id)
    path = store.template_path(template.id)
    assert_same(template_from_hdf5(path), template)
    damaged = path.read_bytes()[:-1]
    path.write_bytes(damaged)
    assert store.put_template_image(image, template.id)
    assert path.read_bytes() == image.read_bytes()
    for bad in ("0" * 64, "", "../" + "a" * 61):
        with pytest.raises(NotFoundError):
            store.template_path(bad)
    before = tree(store.root)
    with pytest.raises(StoreError, match="digest"):
        store.put_template_image(image, "../../x")
    image.write_bytes(damaged)
    with pytest.raises(CorruptFileError):
        store.put_template_image(image, "0" * 64)
    assert tree(store.root) == before


def test_without_uploads_only_what_is_known_is_kept(tmp_path: Path) -> None:
    sequence = sample_sequence(1)
    with ResultStore(tmp_path, keep_uploads=False) as store:
        assert store.put_sequence(sequence, subject="P 1")
        assert not store.put_sequence(sequence)
        store.put_signature(sample_signature(sequence))
        assert not store.sequence_record(sequence.id).has_upload
        with pytest.raises(NotFoundError, match="not kept") as caught:
            store.sequence(sequence.id)
        assert "keeps uploads" in caught.value.remedy
        store.signature(sequence.id, KEY)
    assert verify(tmp_path).is_sound
    with ResultStore(tmp_path) as store:
        assert not store.put_sequence(sequence)
        assert_same(store.sequence(sequence.id), sequence)
        record = store.sequence_record(sequence.id)
        assert (record.subject, record.has_upload) == ("P 1", True)
    assert verify(tmp_path).is_sound


def test_subject_and_label_are_changed_one_by_one(store: ResultStore) -> None:
    sequence = sample_sequence(1)
    store.put_sequence(sequence, subject="a", label="b")
    assert store.update_sequence(sequence.id).label == "b"
    assert store.update_sequence(sequence.id, subject=UNSET, label="c").subject == "a"
    record = store.update_sequence(sequence.id, subject=None)
    assert (record.subject, record.label) == (None, "c")
    assert store.sequence_record(sequence.id) == record
    assert store.list_sequences(label="c").records == (record,)


@pytest.mark.parametrize("text", ["x" * 201, "a\nb", "a\x00b", "\ud800"])
def test_a_name_that_cannot_be_kept_is_refused(text: str, store: ResultStore) -> None:
    sequence = sample_sequence(1)
    with pytest.raises(ParameterError, match="subject"):
        store.put_sequence(sequence, subject=text)
    assert not store.has_sequence(sequence.id)
    store.put_sequence(sequence)
    with pytest.raises(ParameterError, match="label"):
        store.update_sequence(sequence.id, label=text)


@pytest.mark.parametrize(
    "text", ["", " ", "Zoë", "山田\u3000太郎", "a'; DROP TABLE sequences--", "%"]
)
def test_any_other_name_is_kept_and_found(text: str, store: ResultStore) -> None:
    sequence, other = sample_sequence(1), sample_sequence(2)
    store.put_sequence(sequence, subject=text)
    store.put_sequence(other, subject="other")
    found = store.list_sequences(subject=text).records
    assert [(record.id, record.subject) for record in found] == [(sequence.id, text)]


def test_a_deleted_sequence_takes_everything_along(store: ResultStore) -> None:
    kept, gone = sample_sequence(1), sample_sequence(2)
    for sequence in (kept, gone):
        store.put_sequence(sequence)
        store.put_signature(sample_signature(sequence))
        store.put_classification(sample_classification(sequence.id), KEY)
    store.delete_sequence(gone.id)
    assert not store.has_sequence(gone.id)
    for call in (store.sequence, store.delete_sequence, store.signatures):
        with pytest.raises(NotFoundError):
            call(gone.id)
    with pytest.raises(NotFoundError):
        store.signature(gone.id, KEY)
    assert not [name for name in tree(store.root) if gone.id in name]
    assert len(tree(store.root)) == 4
    assert store.put_sequence(gone)
    assert store.signatures(gone.id) == ()
    assert_same(store.signature(kept.id, KEY), sample_signature(kept))


def all_pages(store: ResultStore, limit: int, **filters: str) -> list[str]:
    ids, cursor = [], None
    for _ in range(100):
        page: SequencePage = store.list_sequences(limit=limit, cursor=cursor, **filters)
        assert len(page.records) <= limit
        ids += [record.id for record in page.records]
        cursor = page.cursor
        if cursor is None:
            return ids
    raise AssertionError("the pages do not end")


@pytest.mark.parametrize("limit", [1, 2, 3, 11, 12, 13])
def test_pages_hold_every_sequence_once_newest_first(limit: int, store: ResultStore) -> None:
    expected: list[tuple[str, int]] = []
    for number in range(12):
        sequence = sample_sequence(number)
        store.put_sequence(sequence, subject=f"s{number % 2}", label=f"l{number % 3}")
        expected.insert(0, (sequence.id, number))
    assert all_pages(store, limit) == [name for name, _ in expected]
    for subject in (None, 0, 1):
        for label in (None, 0, 1, 2):
            wanted = [
                name
                for name, number in expected
                if subject in (None, number % 2) and label in (None, number % 3)
            ]
            filters = {}
            if subject is not None:
                filters["subject"] = f"s{subject}"
            if label is not None:
                filters["label"] = f"l{label}"
            assert all_pages(store, limit, **filters) == wanted


def test_a_cursor_stays_where_it_is_while_others_put_and_delete(store: ResultStore) -> None:
    old = [sample_sequence(number).id for number in range(9)]
    for number in range(9):
        store.put_sequence(sample_sequence(number))
    seen: list[str] = []
    cursor = None
    for step in range(100, 200):
        page = store.list_sequences(limit=2, cursor=cursor)
        seen += [record.id for record in page.records]
        cursor = page.cursor
        if cursor is None:
            break
        store.put_sequence(sample_sequence(step))
        # What is deleted on either side of the cursor shifts nothing.
        store.delete_sequence(seen[0] if step % 2 else old.pop(0))
        if step % 2:
            old.remove(seen.pop(0))
    assert [name for name in seen if name in old] == old[::-1]
    assert len(set(seen)) == len(seen)


def test_sequences_of_the_same_moment_are_all_listed(
    store: ResultStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("modalmotion.store.sequences.now", lambda: "2026-01-01T00:00:00.000000Z")
    ids = {sample_sequence(number).id for number in range(7)}
    for number in range(7):
        store.put_sequence(sample_sequence(number))
    assert all_pages(store, 2) == sorted(ids, reverse=True)


@pytest.mark.parametrize("cursor", ["", "x", "not base64!", "YQ", "Ñ", "YWJj" * 1000])
def test_a_cursor_that_no_list_gave_is_refused(cursor: str, store: ResultStore) -> None:
    with pytest.raises(ParameterError, match="cursor"):
        store.list_sequences(cursor=cursor)


@pytest.mark.parametrize("limit", [0, -1, 1001])
def test_the_length_of_a_page_is_limited(limit: int, store: ResultStore) -> None:
    with pytest.raises(ParameterError, match="1 to 1000"):
        store.list_sequences(limit=limit)


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

        with ThreadPoolExecutor(3) as pool:
            readers = [pool.submit(read) for _ in range(3)]
            for _ in range(15):
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
