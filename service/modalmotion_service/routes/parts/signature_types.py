"""Media types of a signature, whether it is kept or of an upload."""

from __future__ import annotations

from typing import Final

from modalmotion_service.http.negotiation import CSV, HDF5, JSON, NPZ, PNG, RAW
from modalmotion_service.routes.parts.openapi_parts import BINARY, TEXT

SIGNATURE_TYPES: Final = (JSON, HDF5, NPZ, RAW, PNG, CSV)
"""RAW is its amplitudes as little-endian float32, CSV a row for each of them."""

SIGNATURE_CONTENT: Final = {**dict.fromkeys(SIGNATURE_TYPES[1:-1], BINARY), CSV: TEXT}
"""All but JSON, which the model of the answer describes."""
