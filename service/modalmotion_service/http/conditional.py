"""Entity tags: an answer that a client has already is not sent again (RFC 9110, 13.1.2)."""

from __future__ import annotations

import hashlib
import re
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

_TAG: Final = re.compile(r'(?:W/)?("[\x21\x23-\x7e\x80-\xff]*")')


def tag_of(*parts: str | bytes) -> str:
    """Make an entity tag of what the answer is made from."""
    digest = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        digest.update(len(data).to_bytes(8, "little") + data)
    return f'"{digest.hexdigest()[:32]}"'


def is_known(request: Request, tag: str) -> bool:
    """Tell whether the client says it has what the tag stands for."""
    condition = request.headers.get("if-none-match")
    return condition is not None and (condition.strip() == "*" or tag in _TAG.findall(condition))


def not_modified(tag: str) -> Response:
    """Answer 304."""
    return Response(status_code=304, headers={"ETag": tag})
