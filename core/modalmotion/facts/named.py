"""Values by name that never change, in the order of their names."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TypeVar

T = TypeVar("T")


class Named(Mapping[str, T]):
    """A mapping that can be hashed, compared and sent to another process.

    Parameters
    ----------
    values : mapping of str to T
        Copied, and sorted by name: equal mappings are written alike.
    """

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[str, T] | None = None) -> None:
        self._values = dict(sorted((values or {}).items()))

    def __getitem__(self, name: str) -> T:
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __eq__(self, other: object) -> bool:
        # As of any mapping, but without making two dictionaries first.
        return self._values == other._values if isinstance(other, Named) else super().__eq__(other)

    def __hash__(self) -> int:
        return hash(tuple(self._values.items()))

    def __repr__(self) -> str:
        return f"Named({self._values!r})"
