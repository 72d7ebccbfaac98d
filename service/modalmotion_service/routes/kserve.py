"""Health and model metadata as the open inference protocol (KServe v2) has them.

Inference goes through `/v1/sequences/{id}/classifications`: a moving mesh is not a tensor.
"""

from __future__ import annotations

import asyncio
from importlib.metadata import version
from typing import Annotated

from fastapi import APIRouter, Path, Request

from modalmotion_service.routes import health
from modalmotion_service.routes.parts.deferral import in_time
from modalmotion_service.routes.parts.dependencies import StateDependency
from modalmotion_service.routes.parts.openapi_parts import PROBLEMS
from modalmotion_service.schemas.kserve import (
    ModelMetadata,
    ModelReady,
    ServerLive,
    ServerMetadata,
    ServerReady,
    TensorMetadata,
)
from modalmotion_service.workspace.models import Models

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
    """Answer while results can be stored and models can be used."""
    health.ready(request)
    return ServerReady(ready=True)


@router.get("/models/{model_name}", responses=PROBLEMS)
async def describe(model_name: ModelName, state: StateDependency) -> ModelMetadata:
    """Give inputs and outputs of a model's newest version, and its versions."""
    return await asyncio.to_thread(_metadata, state.models, model_name)


@router.get("/models/{model_name}/ready", responses=PROBLEMS)
async def model_ready(model_name: ModelName, state: StateDependency) -> ModelReady:
    """Tell whether the newest version loads and gives the answers that it gave when trained."""
    model = await asyncio.to_thread(state.models.choose, model_name)
    await in_time(state, state.models.require_sound(model))
    return ModelReady(name=model.name, ready=True)


def _metadata(models: Models, name: str) -> ModelMetadata:
    model = models.choose(name)
    n_classes = len(models.describe(model).record.classes)
    return ModelMetadata(
        name=model.name,
        versions=[str(version) for version in models.versions(model.name)],
        platform="modalmotion",
        inputs=[TensorMetadata(name="sequence", datatype="BYTES", shape=[1])],
        outputs=[
            TensorMetadata(name="label", datatype="BYTES", shape=[1]),
            TensorMetadata(name="probabilities", datatype="FP64", shape=[n_classes]),
        ],
    )
