"""Values whose arrays cannot be written to."""

from __future__ import annotations

from typing import Any

import numpy as np


class FrozenArrays:
    """A value whose arrays stay read-only in its copies, here and in other processes.

    A pickle and a deep copy forget that an array is read-only.
    """

    def __getstate__(self) -> dict[str, Any]:
        # Hashes of texts differ from process to process.
        return {name: value for name, value in vars(self).items() if name != "_hash"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for value in state.values():
            for part in value if isinstance(value, tuple) else (value,):
                if isinstance(part, np.ndarray):
                    part.setflags(write=False)
        vars(self).update(state)
