"""Elements of FHIR R4 resources: references, narratives, quantities, sampled data."""

from __future__ import annotations

import uuid
from html import escape
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.reports.codes import ABSENT, UCUM

_DECIMALS: Final = 17

# The extension that replaces an element.
_ABSENT_HERE: Final = "http://hl7.org/fhir/StructureDefinition/data-absent-reason"

Resource = dict[str, Any]


def resource(key: uuid.UUID, kind: str, name: str) -> Resource:
    """Begin a resource, whose id follows from the key of the report and its name."""
    return {"resourceType": kind, "id": str(uuid.uuid5(key, name))}


def reference(kind: str, key: uuid.UUID, name: str) -> Resource:
    """Refer to a resource of the same report."""
    return {"reference": f"urn:uuid:{uuid.uuid5(key, name)}", "type": kind}


def narrative(*lines: str) -> Resource:
    """Write lines as XHTML."""
    body = "".join(f"<p>{escape(line, quote=False)}</p>" for line in lines)
    return {
        "status": "generated",
        "div": f'<div xmlns="http://www.w3.org/1999/xhtml">{body}</div>',
    }


def unstated(reason: str) -> Resource:
    """Write the reason for a missing element."""
    return {"extension": [{"url": _ABSENT_HERE, "valueCode": reason}]}


def quantity(value: float, unit: str, ucum: str) -> Resource:
    """Write a number with its unit, in words and as UCUM."""
    # Validators warn of more decimals; what is smaller is written with an exponent.
    held = round(float(value), _DECIMALS) if 1e-4 <= abs(value) < 0.1 else float(value)
    return {"value": held, "unit": unit, "system": UCUM, "code": ucum}


def sampled(
    values: NDArray[np.float64], unit: str, ucum: str, times: NDArray[np.float64] | None
) -> Resource:
    """Write rows of numbers as SampledData; the period is in ms, or 1 if times are unknown."""
    n = len(values)
    period = 1.0
    if times is not None and n > 1 and times[-1] > times[0]:
        period = float(1000.0 * (times[-1] - times[0]) / (n - 1))
    table = values.reshape(n, -1)
    return {
        "origin": {"value": 0.0, "unit": unit, "system": UCUM, "code": ucum},
        "period": period,
        "dimensions": table.shape[1],
        "data": " ".join(_decimal(value) for value in table.ravel().tolist()),
    }


def _decimal(value: float) -> str:
    """Write a number for SampledData, without an exponent."""
    return np.format_float_positional(value, trim="-")


def absent(code: str, text: str) -> Resource:
    """Write the reason for a missing value."""
    return {"dataAbsentReason": {"coding": [{"system": ABSENT, "code": code}], "text": text}}
