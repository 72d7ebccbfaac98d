"""The service as `modalmotion serve` runs it, but for one call: receive a body and hash it.

What that route takes is the least that any upload could: connection, middleware, sha256.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

from fastapi import Request, Response

from modalmotion_service.app import create_app
from modalmotion_service.commands.server import run_app
from modalmotion_service.settings import Settings


async def receive_and_hash(request: Request) -> Response:
    digest = hashlib.sha256()
    async for chunk in request.stream():
        digest.update(chunk)
    return Response(digest.hexdigest())


def main(port: str, data_dir: str) -> None:
    settings = Settings(data_dir=Path(data_dir))
    app = create_app(settings)
    # In the place of a call that is there: one of which nobody has said who may ask is refused.
    app.add_api_route("/v1/decode", receive_and_hash, methods=["POST"])
    app.router.routes.insert(0, app.router.routes.pop())
    run_app(app, settings, "127.0.0.1", int(port))


if __name__ == "__main__":
    main(*sys.argv[1:])
