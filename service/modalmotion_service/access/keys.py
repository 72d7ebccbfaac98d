"""Keys: created, shown once, stored as a hash, revoked; in a file of several processes."""

import abc
import hashlib
import hmac
import os
import re
import secrets
import sqlite3
from collections.abc import Collection, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final, Self

from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.store.database import Database, explained
from modalmotion.store.disk import cannot_write, sync_paths
from modalmotion.store.index import now, to_text
from modalmotion_service.access.scopes import Principal, Scope, require_owner
from modalmotion_service.errors import AuthenticationError

_RESTORE: Final = "Restore it from a backup."


def open_database(path: Path, tables: Sequence[str], version: int) -> Database:
    """Open a SQLite file that only its owner may read; see `Database`."""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        # SQLite gives its log and its shared memory the rights of the file itself.
        is_new = not path.exists()
        os.close(os.open(path, os.O_CREAT | os.O_RDWR, 0o600))
        if is_new:
            sync_paths([path.parent, path.parent.parent])
        # Restored from a backup they may have others.
        with suppress(PermissionError):
            path.parent.chmod(0o700)
            path.chmod(0o600)
    except OSError as error:
        raise cannot_write(path, error) from error
    return Database(path, tables, version, path.name, (_RESTORE, ", or a newer one."))


KEYS: Final = "access/keys.sqlite"
"""Where keys are in a data folder."""

_VERSION: Final = 1
_TABLES: Final = (
    """CREATE TABLE keys (
        id TEXT PRIMARY KEY, owner TEXT NOT NULL, scopes TEXT NOT NULL, sha256 TEXT NOT NULL,
        note TEXT NOT NULL, created TEXT NOT NULL, expires TEXT, revoked TEXT
    ) WITHOUT ROWID""",
)

# The name makes a key that has leaked into a repository or a log easy to find there.
_TOKEN: Final = re.compile(r"mm_([0-9a-f]{16})_([A-Za-z0-9_-]{43})")
_SECRET_BYTES: Final = 32

_REMEDY: Final = "Send `Authorization: Bearer KEY` with a key made by `modalmotion keys create`."


@dataclass(frozen=True)
class Key:
    """Record of a key, without its secret.

    Parameters
    ----------
    id : str
    owner : str
        Whose store it opens.
    scopes : frozenset of Scope
    note : str
        Its purpose.
    created : str
        UTC, ISO 8601.
    expires, revoked : str or None
        UTC, ISO 8601.
    """

    id: str
    owner: str
    scopes: frozenset[Scope]
    note: str
    created: str
    expires: str | None
    revoked: str | None

    @property
    def state(self) -> str:
        """active, expired or revoked."""
        if self.revoked is not None:
            return "revoked"
        return "expired" if self.expires is not None and self.expires <= now() else "active"

    @property
    def principal(self) -> Principal:
        """Owner and scopes that it represents."""
        return Principal(self.owner, self.id, self.scopes)


class Authenticator(abc.ABC):
    """Whoever knows the records of keys, and recognises a key by its own."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:  # noqa: B027 (of a snapshot nothing is open)
        """Close what is open."""

    def authenticate(self, token: str) -> Key:
        """Find the record of a key.

        Raises
        ------
        AuthenticationError
            If the key is not known, or no longer active.
        """
        parts = _TOKEN.fullmatch(token)
        row = None if parts is None else self._row(parts[1])
        if parts is None or row is None:
            raise AuthenticationError("This key is not known.", remedy=_REMEDY)
        # A digest of 256 random bits needs no salt and no slow hash: it cannot be searched.
        if not hmac.compare_digest(_digest(parts[2]), str(row[3])):
            raise AuthenticationError("This key is not known.", remedy=_REMEDY)
        key = _key(row)
        if key.state != "active":
            error = AuthenticationError(f"This key is {key.state}.", remedy=_REMEDY)
            error.key_id = key.id
            raise error
        return key

    @abc.abstractmethod
    def _row(self, key_id: str) -> tuple[Any, ...] | None:
        """Give the row of a key as the table has it."""


class KeyRing(Authenticator):
    """The keys of a data folder; server and command line may have it open at once.

    Parameters
    ----------
    data_dir : Path
    """

    def __init__(self, data_dir: Path) -> None:
        self._database = open_database(data_dir / KEYS, _TABLES, _VERSION)

    def __exit__(self, *_: object) -> None:
        self._database.close()

    def create(
        self,
        owner: str,
        scopes: Collection[Scope],
        *,
        note: str = "",
        expires: datetime | None = None,
        token: str = "",
    ) -> tuple[Key, str]:
        """Make a key.

        Parameters
        ----------
        owner : str
        scopes : collection of Scope
        note : str
        expires : datetime, optional
            With its time zone.
        token : str
            The key itself, where it was made elsewhere; one is drawn by default.

        Returns
        -------
        tuple of Key and str
            The record that is stored, and the key itself, which is not.

        Raises
        ------
        ParameterError
            If the owner's name is not valid, there is no scope, the time has passed, or the
            token is no key.
        """
        require_owner(owner)
        if not scopes:
            raise ParameterError("A key without a scope opens nothing.", remedy="Name a scope.")
        end = None if expires is None else to_text(expires.timestamp())
        if end is not None and end <= now():
            raise ParameterError("The key would have expired already.", remedy="Name a later day.")
        token = token or f"mm_{secrets.token_hex(8)}_{secrets.token_urlsafe(_SECRET_BYTES)}"
        key_id, secret = parts_of(token)
        key = Key(key_id, owner, frozenset(scopes), note[:200], now(), end, None)
        self._write(
            "INSERT INTO keys VALUES (?, ?, ?, ?, ?, ?, ?, NULL)",
            (key.id, owner, ",".join(sorted(scopes)), _digest(secret), key.note, key.created, end),
        )
        return key, token

    def revoke(self, key_id: str) -> Key:
        """Take a key back, at once and for good.

        Raises
        ------
        NotFoundError
            If no key has that id.
        """
        self._write("UPDATE keys SET revoked = coalesce(revoked, ?) WHERE id = ?", (now(), key_id))
        row = self._row(key_id)
        if row is None:
            raise NotFoundError(
                f"There is no key {key_id[:40]!r}.", remedy="Use an id of `modalmotion keys list`."
            )
        return _key(row)

    def all(self) -> list[Key]:
        """Every key that was ever made, oldest first."""
        return [*map(_key, self._database.read("SELECT * FROM keys ORDER BY created, id"))]

    def _row(self, key_id: str) -> tuple[Any, ...] | None:
        return next(iter(self._database.read("SELECT * FROM keys WHERE id = ?", (key_id,))), None)

    def _write(self, statement: str, values: tuple[Any, ...]) -> None:
        with self._database.write() as connection:
            connection.execute(statement, values)


def parts_of(token: str) -> tuple[str, str]:
    """Split a key into its id and its secret.

    Raises
    ------
    ParameterError
        If it has not the form of a key.
    """
    parts = _TOKEN.fullmatch(token)
    if parts is None:
        raise ParameterError(
            "A key is mm_, 16 hexadecimal digits, _ and 43 letters of base64url; this one has "
            f"{len(token)} letters in all.",
            remedy="Use one that `modalmotion keys create` made, in any folder.",
        )
    return parts[1], parts[2]


def key_required() -> AuthenticationError:
    """Make the error of a request that comes without a key."""
    return AuthenticationError("This request needs a key.", remedy=_REMEDY)


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def _key(row: tuple[Any, ...]) -> Key:
    key_id, owner, scopes, _, note, created, expires, revoked = row
    named = frozenset(Scope(name) for name in scopes.split(","))
    return Key(key_id, owner, named, note, created, expires, revoked)


class KeySnapshot(Authenticator):
    """Keys as they are in a file now, which may be replaced at any time.

    It is opened anew for each look: a key that was taken back, or a file that was replaced, counts
    at once. Nothing is written, not even beside it: the folder may be one that nobody can write to.
    While the file is away or damaged every key is refused with an error of the store.

    Parameters
    ----------
    data_dir : Path or None
        None knows no key.
    """

    def __init__(self, data_dir: Path | None) -> None:
        self._path = None if data_dir is None else data_dir / KEYS
        len(self)  # a damaged file is found at once

    def __len__(self) -> int:
        """Give how many keys are known, whether they are active or not."""
        if self._path is None or not self._path.exists():
            return 0
        (number,) = self._first("SELECT count(*) FROM keys", self._path) or (0,)
        return int(number)

    def _row(self, key_id: str) -> tuple[Any, ...] | None:
        if self._path is None:
            return None
        return self._first("SELECT * FROM keys WHERE id = ?", self._path, key_id)

    @staticmethod
    def _first(statement: str, path: Path, *values: str) -> tuple[Any, ...] | None:
        with explained(path.name, _RESTORE):
            log = path.with_name(f"{path.name}-wal")
            # Immutable, unless a service has it open whose newest rows are beside it: else SQLite
            # would make files there, to share it with writers.
            try:
                is_live = log.stat().st_size > 0
            except OSError as error:
                # One that is there and cannot be looked at may revoke what the file still has.
                is_live = not isinstance(error, FileNotFoundError)
            how = "mode=ro" if is_live else "mode=ro&immutable=1"
            address = f"{path.absolute().as_uri()}?{how}"
            with closing(sqlite3.connect(address, uri=True)) as file:
                found: tuple[Any, ...] | None = file.execute(statement, values).fetchone()
                return found
