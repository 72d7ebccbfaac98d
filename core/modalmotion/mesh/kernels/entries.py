"""Entries of the kernels: addresses become arrays, as long as their caller says."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import signature
from typing import Any, Final

from numba import carray

from modalmotion.mesh.kernels import cycle, levels, measures, sides

# Nothing compares an index with it.
_ANY: Final = 1 << 40

# Letters as `numeric.machine.building.Entries` has them.
_KERNELS: Final[Mapping[Callable[..., int | None], str]] = {
    sides.join_sides: "iiUULUBBU",
    sides.name_pieces: "iUUU",
    sides.sort_codes: "iLULUL",
    measures.weigh_edges: "iDUUDD",
    measures.add_weights: "iUUDD",
    measures.keep_free: "iUUDUiUUD",
    measures.add_gradients: "iDUDiD",
    measures.add_normals: "iDUD",
    measures.add_covered: "iUDDiiD",
    levels.whole_rows: "iUUDUUD",
    levels.group_unknowns: "iUUDDdU",
    levels.smooth_groups: "iUUDDUdUUD",
    levels.turn_over: "iiUUDUUD",
    levels.image_rows: "iUUDDUUDUUUDi",
    levels.coarser: "iUUDUUDUUUDDi",
    cycle.go_down: "iUUFFFFFUUFF",
    cycle.go_up: "iUUFFFFFUUFF",
    cycle.multiply: "iUUDDDDD",
    cycle.step_along: "idDDDDD",
    cycle.scaled_to: "iDdF",
    cycle.turn_to: "iDFD",
    cycle.redirect: "idFdD",
}


def _entry(kernel: Any, letters: str) -> Callable[..., int]:
    """Make the entry of a kernel: it takes addresses for arrays, and gives 0 where it gives none.

    Compiled code knows no list of arguments of several types, so each entry is written out.
    """
    name, shape = kernel.__name__, signature(kernel)
    given = [
        word if letter in "id" else f"carray({word}, {_ANY})"
        for word, letter in zip(shape.parameters, letters, strict=True)
    ]
    call = f"kernel({', '.join(given)})"
    body = f"{call}; return 0" if shape.return_annotation == "None" else f"return {call}"
    made: dict[str, Any] = {"kernel": kernel, "carray": carray}
    # Of names and letters that stand above.
    exec(f"def {name}({', '.join(shape.parameters)}): {body}", made)  # noqa: S102
    entry: Callable[..., int] = made[name]
    return entry


ENTRIES: Final = {_entry(kernel, letters): letters for kernel, letters in _KERNELS.items()}
