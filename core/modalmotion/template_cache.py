"""Templates and factored modes that were made before, by their content."""

from __future__ import annotations

from collections import OrderedDict
from threading import Lock
from typing import Generic, TypeVar

from modalmotion.basis import Basis, make_basis
from modalmotion.sequence import MeshSequence
from modalmotion.template import (
    GivenLandmarks,
    ModeChoice,
    Template,
    Weights,
    choose_modes,
    make_template,
    template_id,
)

_Value = TypeVar("_Value")


class TemplateCache:
    """The last templates and factored modes, for threads that share them.

    What comes out is what would be made anew: templates are found by what they are made from.

    Parameters
    ----------
    n_templates, n_bases : int
        How many of each are kept; the longest unused go first. A template of 10,000 vertices
        takes 1 MB, its factored modes 0.25 MB for each mode.
    """

    def __init__(self, n_templates: int = 64, n_bases: int = 64) -> None:
        self._templates: _Recent[Template] = _Recent(n_templates)
        self._bases: _Recent[tuple[ModeChoice, Basis]] = _Recent(n_bases)

    def template(
        self,
        sequence: MeshSequence,
        *,
        reference: int = 0,
        weights: Weights = Weights.AREA,
        landmarks: GivenLandmarks | None = None,
        closed_form: bool = True,
    ) -> Template:
        """Return the template of a sequence: see `make_template`."""
        # A frame that does not exist has no content; making the template says so.
        key = (
            template_id(
                sequence,
                reference=reference,
                weights=weights,
                landmarks=landmarks,
                closed_form=closed_form,
            )
            if 0 <= reference < sequence.n_frames
            else ""
        )
        found = self._templates.get(key)
        if found is None:
            found = make_template(
                sequence,
                reference=reference,
                weights=weights,
                landmarks=landmarks,
                closed_form=closed_form,
            )
            self._templates.put(key, found)
        return found

    def basis(
        self, template: Template, n_modes: int, grid: tuple[int, ...] | None = None
    ) -> tuple[ModeChoice, Basis]:
        """Choose and factor the modes of a template: see `choose_modes` and `make_basis`."""
        key = f"{template.id} {n_modes} {grid}"
        found = self._bases.get(key)
        if found is None:
            choice = choose_modes(template, n_modes, grid)
            found = (choice, make_basis(template, choice.modes))
            self._bases.put(key, found)
        return found


class _Recent(Generic[_Value]):
    """A mapping that forgets what was not used for longest."""

    def __init__(self, n_most: int) -> None:
        self._n_most = n_most
        self._values: OrderedDict[str, _Value] = OrderedDict()
        self._lock = Lock()

    def get(self, key: str) -> _Value | None:
        with self._lock:
            if key not in self._values:
                return None
            self._values.move_to_end(key)
            return self._values[key]

    def put(self, key: str, value: _Value) -> None:
        with self._lock:
            self._values[key] = value
            self._values.move_to_end(key)
            while len(self._values) > self._n_most:
                self._values.popitem(last=False)
