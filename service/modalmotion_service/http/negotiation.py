"""What the headers of a request ask for: a media type, an answer at once, only what is new."""

import hashlib
import re
from typing import Final

from starlette.exceptions import HTTPException
from starlette.requests import Request

from modalmotion_service.document import OCTETS, is_file

JSON: Final = "application/json"
NDJSON: Final = "application/x-ndjson"
HDF5: Final = "application/x-hdf5"
NPZ: Final = "application/x-npz"
GLB: Final = "model/gltf-binary"
VTKHDF: Final = "application/vnd.vtk.vtkhdf"
ZIP: Final = "application/zip"
RAW: Final = OCTETS
STREAM: Final = "application/vnd.modalmotion.stream"
PNG: Final = "image/png"
CSV: Final = "text/csv"
HTML: Final = "text/html"
MARKDOWN: Final = "text/markdown"
FHIR: Final = "application/fhir+json"
PDF: Final = "application/pdf"
VIEW: Final = "application/vnd.modalmotion.view"


def best_type(accept: str, offered: tuple[str, ...]) -> str:
    """Choose by the Accept header (RFC 9110, 12.5.1); the first on offer where all are equal.

    Any file is a stream of octets: who accepts only those gets the first file on offer.

    Raises
    ------
    HTTPException
        406 if nothing on offer is acceptable.
    """
    octets = RAW not in offered
    ranges = [_parse(part) for part in accept.split(",") if part.strip()]
    best, best_quality = "", 0.0
    for offer in offered:
        # The most specific range that matches decides on its quality.
        matching = [(specific, q) for name, specific, q in ranges if _matches(name, offer, octets)]
        quality = max(matching)[1] if matching else (0.0 if ranges else 1.0)
        if quality > best_quality:
            best, best_quality = offer, quality
    if not best:
        raise HTTPException(406, f"None of {', '.join(offered)} is acceptable to this client.")
    return best


def _parse(part: str) -> tuple[str, int, float]:
    name, *parameters = (piece.strip().lower() for piece in part.split(";"))
    quality = 1.0
    for parameter in parameters:
        if parameter.startswith("q="):
            try:
                quality = min(max(float(parameter[2:]), 0.0), 1.0)
            except ValueError:
                quality = 0.0
    specific = 0 if name == "*/*" else 1 if name.endswith("/*") else 2
    return name, specific, quality


def _matches(name: str, offer: str, octets: bool) -> bool:
    return (
        name in ("*/*", offer)
        or (name.endswith("/*") and offer.startswith(name[:-1]))
        or (octets and name == RAW and is_file(offer))
    )


_WAIT = re.compile(r"wait\s*=\s*\"?(\d{1,6})\"?")


def preferred_wait(header: str) -> float | None:
    """Read from a Prefer header after how many seconds a job is wanted in place of an answer.

    0 where it says respond-async, None where it says nothing; unknown parts are ignored, as the
    standard requires.
    """
    wait = None
    for word in map(str.strip, re.split("[,;]", header.lower())):
        if word == "respond-async":
            return 0.0
        if (match := _WAIT.fullmatch(word)) is not None:
            wait = float(match[1])
    return wait


_TAG: Final = re.compile(r'(?:W/)?("[\x21\x23-\x7e\x80-\xff]*")')


def tag_of(*parts: str | bytes) -> str:
    """Make an entity tag of what the answer is made from."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little") + data)
    return f'"{digest.hexdigest()[:32]}"'


def is_known(request: Request, tag: str) -> bool:
    """Return whether the client says it has what the tag represents."""
    condition = request.headers.get("if-none-match")
    return condition is not None and (condition.strip() == "*" or tag in _TAG.findall(condition))


def attachment(name: str) -> dict[str, str]:
    """Name the file that an answer is saved as."""
    return {"Content-Disposition": f'attachment; filename="{name}"'}
