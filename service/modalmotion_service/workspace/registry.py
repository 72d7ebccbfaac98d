"""The registry of operations."""

from __future__ import annotations

from typing import Final

from modalmotion_service.workspace import (
    file_operations,
    model_operations,
    sequence_operations,
    signature_operations,
)
from modalmotion_service.workspace.operation import Operation

_MODULES: Final = (sequence_operations, signature_operations, file_operations, model_operations)

OPERATIONS: Final[dict[str, Operation]] = {
    one.name: one
    for module in _MODULES
    for one in vars(module).values()
    if isinstance(one, Operation)
}
"""All operations, by name."""
