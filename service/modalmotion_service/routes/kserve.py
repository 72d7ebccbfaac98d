"""Health and model metadata as the open inference protocol (KServe v2) has them.

Inference goes through `/v1/sequences/{id}/classifications`: a moving mesh is no tensor.
"""

from __future__ import annotations

import asyncio
from importlib.metadata import version
from typing import Annotated

from fastapi import APIRouter, Path, Request

from modalmotion.classify import load_model
from modalmotion_service.openapi_parts import PROBLEMS
from modalmotion_service.schemas.kserve import (
    ModelMetadata,
    ModelReady,
    ServerLive,
    ServerMetadata,
    ServerReady,
    TensorMetadata,
)

router = APIRouter(prefix="/v2", tags=["KServe v2"])

ModelName = Annotated[str, Path(pattern="^[A-Za-z0-9._-]{1,100}$", description="Of a model.")]


@router.get("")
async def server() -> ServerMetadata:
    """Give the server's name and version."""
    return ServerMetadata(name="modalmotion", version=version("modalmotion"), extensions=[])


@router.get("/health/live")
async def live() -> ServerLive:
    """Answer while the process runs."""
    return ServerLive(live=True)


@router.get("/health/ready", responses={503: PROBLEMS[503]})
def ready(request: Request) -> ServerReady:
    """Answer while results can be kept and models can be asked."""
    request.app.state.owners.local.store.list_sequences(limit=1)
    return ServerReady(ready=True)


@router.get("/models/{model_name}", responses=PROBLEMS)
async def describe(model_name: ModelName) -> ModelMetadata:
    """Say what a model takes and gives."""
    model = await asyncio.to_thread(load_model, model_name)
    return ModelMetadata(
        name=model.name,
        versions=[model.id],
        platform="modalmotion",
        inputs=[TensorMetadata(name="sequence", datatype="BYTES", shape=[1])],
        outputs=[
            TensorMetadata(name="label", datatype="BYTES", shape=[1]),
            TensorMetadata(name="probabilities", datatype="FP64", shape=[len(model.classes)]),
        ],
    )


@router.get("/models/{model_name}/ready", responses=PROBLEMS)
async def model_ready(model_name: ModelName) -> ModelReady:
    """Tell whether a model loads and says again what it said when it was made."""
    model = await asyncio.to_thread(load_model, model_name)
    return ModelReady(name=model.name, ready=True)
