"""Cache of templates and factored modes, by their content."""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Final, Generic, TypeVar

from modalmotion.fit.basis import Basis, make_basis
from modalmotion.template import ModeChoice, Template, choose_modes

_Value = TypeVar("_Value")

# A basis keeps shapes and projector, both also laid out the other way.
_LAYOUTS: Final = 4


class TemplateCache:
    """The last templates and factored modes, for threads that share them.

    Parameters
    ----------
    n_templates, n_bases : int
        Largest number of each; the longest unused go first. A template of 10,000 vertices
        takes 1 MB, its factored modes 0.3 MB for each mode.
    most_bytes : int
        Memory for each of the two; anything larger is not stored.
    """

    def __init__(
        self, n_templates: int = 64, n_bases: int = 64, most_bytes: int = 256_000_000
    ) -> None:
        self._templates: _Recent[Template] = _Recent(n_templates, most_bytes)
        self._bases: _Recent[tuple[ModeChoice, Basis]] = _Recent(n_bases, most_bytes)
        self._name = ""

    def part(self, name: str) -> TemplateCache:
        """Return a cache that shares the room of this one, and none of what other parts hold."""
        part = copy.copy(self)
        part._name = f"{self._name}{name}\n"
        return part

    def named(self, template_id: str, load: Callable[[], Template]) -> Template:
        """Return the template of an id, loaded if it is not here."""
        key = f"{self._name}{template_id}"
        template = self._templates.get(key)
        if template is None:
            template = load()
            self._templates.put(key, template, _size(template))
        return template

    def basis(
        self,
        template: Template,
        n_modes: int,
        grid: tuple[int, ...] | None = None,
        *,
        split_pairs: bool = False,
    ) -> tuple[ModeChoice, Basis]:
        """Choose and factor the modes of a template: see `choose_modes` and `make_basis`."""
        key = f"{self._name}{template.id} {n_modes} {grid} {split_pairs}"
        entry = self._bases.get(key)
        if entry is None:
            choice = choose_modes(template, n_modes, grid, split_pairs=split_pairs)
            entry = (choice, make_basis(template, choice.modes))
            self._bases.put(key, entry, _LAYOUTS * entry[1].shapes.nbytes)
        return entry


def _size(template: Template) -> int:
    arrays = (template.coordinates, template.weights, template.vertices, template.faces)
    return sum(array.nbytes for array in arrays)


class _Recent(Generic[_Value]):
    """A mapping that forgets what was not used for longest."""

    def __init__(self, n_most: int, most_bytes: int) -> None:
        self._n_most = n_most
        self._most_bytes = most_bytes
        self._n_bytes = 0
        self._values: OrderedDict[str, tuple[_Value, int]] = OrderedDict()
        self._lock = Lock()

    def get(self, key: str) -> _Value | None:
        with self._lock:
            if key not in self._values:
                return None
            self._values.move_to_end(key)
            return self._values[key][0]

    def put(self, key: str, value: _Value, n_bytes: int) -> None:
        if n_bytes > self._most_bytes:
            return
        with self._lock:
            if key in self._values:
                # Another thread was quicker with the same.
                return
            self._values[key] = (value, n_bytes)
            self._n_bytes += n_bytes
            while len(self._values) > self._n_most or self._n_bytes > self._most_bytes:
                self._n_bytes -= self._values.popitem(last=False)[1][1]
