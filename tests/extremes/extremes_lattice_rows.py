"""Numerical extremes of lattices: what is right, and how near we come.

`ROWS` is read by the tests, which hold every row to its bound, and by the program that writes
the table of extremes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import extremes_basis_rows
import extremes_input_rows
import extremes_label_rows
import extremes_motion_rows

Row = tuple[str, str, Callable[[], float], float, Callable[[], float] | None]

ROWS: Final[list[Row]] = [
    *extremes_basis_rows.ROWS,
    *extremes_label_rows.ROWS,
    *extremes_motion_rows.ROWS,
    *extremes_input_rows.ROWS,
]
