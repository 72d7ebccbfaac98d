"""Small files of JSON that end with the sha256 of the text before it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from modalmotion.errors import CorruptFileError, OlderFileError, StoreError
from modalmotion.hdf5.sealed import read_file


@dataclass(frozen=True)
class JsonForm:
    """Kind and version of such a file.

    Parameters
    ----------
    kind : str
        "sequence-record" or "deleted-model".
    version : int
        Of its schema.
    remedy : str
        Advice for a damaged one.
    """

    kind: str
    version: int
    remedy: str

    @property
    def schema(self) -> str:
        """Name of the schema in the file."""
        return f"modalmotion.{self.kind}"

    def write(self, record: dict[str, Any]) -> bytes:
        """Write a file in memory, the same bytes for the same record."""
        content = {"schema": self.schema, "schema_version": self.version, "record": record}
        return json.dumps({**content, "sha256": _digest(content)}, indent=1).encode()

    def read(self, path: Path) -> dict[str, Any]:
        """Read the record in a file.

        Raises
        ------
        NotFoundError
            If there is no such file.
        CorruptFileError
            If it is damaged.
        OlderFileError
            If it was written by an older version.
        StoreError
            If it was written by a newer version.
        """
        try:
            content: dict[str, Any] = json.loads(read_file(path))
            is_whole = content.pop("sha256") == _digest(content)
            schema, version = content["schema"], content["schema_version"]
            record: dict[str, Any] = content["record"]
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise self.damaged(path, str(error)) from error
        if not is_whole:
            raise self.damaged(path, "its fields do not have the sha256 that it states")
        # Not called damaged from here on, for what is damaged may be written anew.
        if (schema, version) != (self.schema, self.version):
            is_older = schema == self.schema and version < self.version
            raise (OlderFileError if is_older else StoreError)(
                f"'{path.name}' has the schema {str(schema)[:40]!r}, version {str(version)[:10]}, "
                f"not {self.schema!r}, version {self.version}.",
                remedy="Read it with the modalmotion that wrote it.",
            )
        return record

    def damaged(self, path: Path, reason: str) -> CorruptFileError:
        """Error for a file that does not contain what it should."""
        return CorruptFileError(
            f"The {self.kind.replace('-', ' ')} '{path.parent.name}/{path.name}' is damaged "
            f"({reason[:100]}).",
            remedy=self.remedy,
        )


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
