"""Records of models, known without reading their arrays, and references to models."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, NamedTuple

from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.representation import shown
from modalmotion.signature.making import SignatureParameters

NAME_PATTERN: Final = "[a-z0-9](?:[a-z0-9._-]{0,62}[a-z0-9])?"
VERSION_PATTERN: Final = "[1-9][0-9]{0,8}"

_NAME: Final = re.compile(NAME_PATTERN)
_REFERENCE: Final = re.compile(f"({NAME_PATTERN})(?:@({VERSION_PATTERN}))?")


class ModelReference(NamedTuple):
    """Name and version of a model.

    Parameters
    ----------
    name : str
    version : int or None
        None represents the newest.
    """

    name: str
    version: int | None

    def __str__(self) -> str:
        return self.name if self.version is None else f"{self.name}@{self.version}"


@shown("name", "version", "classes", "created", "deleted", "id")
@dataclass(frozen=True)
class ModelRecord:
    """One version of a model, as the index knows it.

    Parameters
    ----------
    name : str
    version : int
        Counted from 1 for each name; never used twice, not even after a deletion.
    id : str
        sha256 of everything that the model's answers depend on, in hex.
    classes : tuple of str
    parameters : SignatureParameters
        Of the signatures that it reads.
    created : str
        When it was put, UTC, ISO 8601 with microseconds.
    training : str or None
        Name of the training that made it, so that one which is begun again finds it.
    deleted : str or None
        When it was deleted; only its name, number and id are known from then on.
    """

    name: str
    version: int
    id: str
    classes: tuple[str, ...]
    parameters: SignatureParameters
    created: str
    training: str | None = None
    deleted: str | None = None

    @property
    def reference(self) -> ModelReference:
        """Name and version."""
        return ModelReference(self.name, self.version)


def is_model_name(text: object) -> bool:
    """Return whether a model may be called this; only such a text becomes a folder's name."""
    # Lower case, for on some file systems "A" and "a" are one folder.
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


def require_model_name(text: str) -> str:
    """Check the name of a new model.

    Raises
    ------
    ParameterError
        If it cannot be kept.
    """
    if not is_model_name(text):
        raise ParameterError(
            f"A model cannot be called {text[:80]!r}.",
            remedy="Use 1 to 64 lower-case letters, digits, '.', '_' and '-', with a letter or "
            "a digit at both ends.",
            details={"pattern": f"^{NAME_PATTERN}$"},
        )
    return text


def parse_reference(text: str) -> ModelReference:
    """Read a reference to a model: "name" for its newest version, or "name@3".

    Raises
    ------
    NotFoundError
        If it is neither: no model has such a name.
    """
    match = _REFERENCE.fullmatch(text)
    if match is None:
        raise NotFoundError(
            f"{text[:80]!r} names no model.",
            remedy="Write its name, such as wall-motion, for the newest version, or its name "
            "and a version, such as wall-motion@3.",
        )
    return ModelReference(match[1], None if match[2] is None else int(match[2]))
