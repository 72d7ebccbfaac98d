"""Keys of a folder that is only read."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from modalmotion.errors import CorruptFileError, StoreError
from modalmotion_service.access.keys import KeyRing, KeySnapshot
from modalmotion_service.access.scopes import Scope
from modalmotion_service.errors import AuthenticationError


def kept(folder: Path) -> tuple[str, str]:
    with KeyRing(folder) as ring:
        key, token = ring.create("alice", [Scope.READ])
        other, gone = ring.create("bob", [Scope.READ])
        ring.revoke(other.id)
    assert key.owner == "alice"
    return token, gone


def test_a_key_is_recognised_and_nothing_is_written(tmp_path: Path) -> None:
    token, gone = kept(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    keys = KeySnapshot(tmp_path)
    assert len(keys) == 2
    assert keys.authenticate(token).principal.owner == "alice"
    with pytest.raises(AuthenticationError, match="revoked"):
        keys.authenticate(gone)
    for wrong in (f"{token[:-1]}A" if token[-1] != "A" else f"{token[:-1]}B", "x"):
        with pytest.raises(AuthenticationError, match="not known"):
            keys.authenticate(wrong)
    assert sorted(tmp_path.rglob("*")) == before


def test_another_file_in_its_place_counts_at_once(tmp_path: Path) -> None:
    token, _ = kept(tmp_path / "a")
    newer, _ = kept(tmp_path / "b")
    keys = KeySnapshot(tmp_path / "a")
    path = tmp_path / "a" / "access" / "keys.sqlite"
    (tmp_path / "b" / "access" / "keys.sqlite").replace(path)
    assert keys.authenticate(newer).owner == "alice"
    with pytest.raises(AuthenticationError):
        keys.authenticate(token)
    # Away or damaged, nobody passes.
    path.write_bytes(b"no database at all, but long enough to be looked at as one" * 20)
    with pytest.raises(CorruptFileError):
        keys.authenticate(newer)
    path.unlink()
    with pytest.raises(StoreError):
        keys.authenticate(newer)


def test_a_copy_that_brings_its_own_time_with_it_counts_at_once(tmp_path: Path) -> None:
    token, _ = kept(tmp_path)
    path = tmp_path / "access" / "keys.sqlite"
    os.utime(path, (1e9, 1e9))
    before = path.stat()
    keys = KeySnapshot(tmp_path)
    key = keys.authenticate(token)
    with KeyRing(tmp_path) as ring:
        ring.revoke(key.id)
    os.utime(path, (1e9, 1e9))
    after = path.stat()
    assert (after.st_size, after.st_mtime_ns, after.st_ino) == (
        *(before.st_size, before.st_mtime_ns, before.st_ino),
    )
    with pytest.raises(AuthenticationError, match="revoked"):
        keys.authenticate(token)


def test_without_a_folder_no_key_is_known() -> None:
    with pytest.raises(AuthenticationError):
        KeySnapshot(None).authenticate("mm_" + "0" * 16 + "_" + "x" * 43)


def test_what_a_service_changes_meanwhile_counts_at_once(tmp_path: Path) -> None:
    with KeyRing(tmp_path) as ring:
        token = ring.create("alice", [Scope.READ])[1]
        keys = KeySnapshot(tmp_path)
        key = keys.authenticate(token)
        ring.revoke(key.id)
        with pytest.raises(AuthenticationError, match="revoked"):
            keys.authenticate(token)


@pytest.mark.parametrize("number", [errno.EIO, errno.ESTALE, errno.EACCES])
def test_a_log_that_cannot_be_looked_at_lets_no_revoked_key_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    look = Path.stat

    def fails(path: Path, **how: bool) -> os.stat_result:
        if path.name.endswith("-wal"):
            raise OSError(number, os.strerror(number))
        return look(path, **how)

    with KeyRing(tmp_path) as ring:
        token = ring.create("alice", [Scope.READ])[1]
    with KeyRing(tmp_path) as ring:
        keys = KeySnapshot(tmp_path)
        ring.revoke(keys.authenticate(token).id)
        monkeypatch.setattr(Path, "stat", fails)
        with pytest.raises((AuthenticationError, StoreError)):
            keys.authenticate(token)
