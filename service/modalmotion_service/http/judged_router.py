"""Routes that are refused unless the gate has judged them."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Depends

from modalmotion_service.http.gate import require_judged


class JudgedRouter(APIRouter):
    """Router of which every route requires the gate's judgement.

    An application takes its routes as they are. Of a router that is included in another the
    framework makes every route again, at the first request that looks for one: a third of a
    second.

    Parameters
    ----------
    **options
        As of the framework's router.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(dependencies=[Depends(require_judged)], **options)
