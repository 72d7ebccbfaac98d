"""Health, model metadata and inference as the open inference protocol (KServe v2) has them.

A moving mesh is no tensor of numbers: the input is a file, as a tensor of one element of bytes.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from importlib.metadata import version
from typing import Annotated, Any, Final

from fastapi import Path, Request, Response
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError

from modalmotion.classification import Classification
from modalmotion.errors import MalformedFileError, ModalMotionError, ParameterError
from modalmotion_service.http.json_bodies import parse_json
from modalmotion_service.http.judged_router import JudgedRouter
from modalmotion_service.http.negotiation import JSON, RAW
from modalmotion_service.http.tensors import HEADER, binary_body, element, head_length, split_head
from modalmotion_service.routes import health
from modalmotion_service.routes.parts.deferral import in_time
from modalmotion_service.routes.parts.dependencies import StateDependency
from modalmotion_service.routes.parts.openapi_parts import BINARY, PROBLEMS, schema_of
from modalmotion_service.schemas import ModelVersion
from modalmotion_service.schemas.kserve import (
    OUTPUTS,
    InferenceAnswer,
    InferenceRequest,
    InputTensor,
    ModelMetadata,
    ModelReady,
    RequestedOutput,
    ServerLive,
    ServerMetadata,
    ServerReady,
    TensorMetadata,
)
from modalmotion_service.schemas.request_queries import ClassifyQuery
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.model_versions import ChosenModel
from modalmotion_service.workspace.models import Models
from modalmotion_service.workspace.state import State

router = JudgedRouter(prefix="/v2", tags=["KServe v2"])

_BINARY: Final = "binary_tensor_data"

_BODY: Final[dict[str, Any]] = {
    "parameters": [
        {
            "name": HEADER,
            "in": "header",
            "required": False,
            "schema": {"type": "string", "pattern": "^[0-9]{1,6}$"},
            "description": "Bytes of JSON at the beginning of the body.",
        }
    ],
    "requestBody": {
        "required": True,
        "description": "JSON, or JSON with a binary tensor behind it.",
        "content": {
            JSON: {"schema": schema_of(InferenceRequest)},
            RAW: BINARY,
        },
    },
}
_ANSWERS: Final[dict[int | str, dict[str, Any]]] = {**PROBLEMS, 200: {"content": {RAW: BINARY}}}

ModelName = Annotated[str, Path(pattern="^[A-Za-z0-9._-]{1,100}$", description="Of a model.")]


@router.get("")
async def server() -> ServerMetadata:
    """Give the server's name and version."""
    return ServerMetadata(name="modalmotion", version=version("modalmotion"), extensions=[_BINARY])


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


@router.post(
    "/models/{model_name}/infer",
    response_model=InferenceAnswer,
    openapi_extra=_BODY,
    responses=_ANSWERS,
)
async def infer(model_name: ModelName, request: Request, state: StateDependency) -> Response:
    """Classify a file's motion with the newest version of a model; nothing is stored.

    The input `sequence` is the file, the outputs are as `/v1/classify` gives them, bit for bit.
    With the binary extension, the file follows the JSON, whose length the header
    `Inference-Header-Content-Length` states. No job does this: what takes long goes to `/v1`.
    """
    return await _inferred(state, request, model_name)


@router.post(
    "/models/{model_name}/versions/{version}/infer",
    response_model=InferenceAnswer,
    openapi_extra=_BODY,
    responses=_ANSWERS,
)
async def infer_with(
    model_name: ModelName, version: ModelVersion, request: Request, state: StateDependency
) -> Response:
    """Classify a file's motion with a version of a model, as the newest does."""
    return await _inferred(state, request, f"{model_name}@{version}")


async def _inferred(state: State, request: Request, reference: str) -> Response:
    try:
        model = await asyncio.to_thread(state.models.choose, reference)
        pieces = request.stream()
        length = head_length(request.headers.get(HEADER))
        head, first = await split_head(pieces, length)
        wanted = _request_of(head)
        query = _query_of(wanted, reference)
        (sent,) = wanted.inputs
        size = sent.parameters.get("binary_data_size")
        if (size is None) == (sent.data is None) or (size is None) != (length is None):
            raise MalformedFileError(
                "The file must come once: as text in data, or as a binary tensor.",
                remedy=f"Send {HEADER} and binary_data_size with a binary tensor, and neither "
                "with data.",
            )
        data = element(first, pieces, size) if size is not None else _text(sent)
        with await state.spool.receive(data, hashed=False) as file:
            upload = Upload(file.path, query.options(state.settings.read_limits, file.facts))
            work = state.models.classify(upload, model, query.coverage)
            result, _reading = await in_time(state, work)
    except ModalMotionError as error:
        # Clients of the protocol show this member.
        error.details = {**error.details, "error": error.message}
        raise
    return _answer_of(wanted, model, result)


def _request_of(head: bytes) -> InferenceRequest:
    try:
        value = parse_json(head)
        if isinstance(value, dict):
            return InferenceRequest.model_validate(value)
        where, message = "body", "Input should be an object"
    except ValidationError as error:
        first = error.errors(include_input=False, include_url=False)[0]
        where, message = ".".join(map(str, first["loc"])), first["msg"]
    except RequestValidationError:
        where, message = "body", "JSON decode error"
    raise MalformedFileError(
        f"The request is none of the open inference protocol: {where[:200]}: {message}.",
        remedy="See /docs, or use a client of the protocol.",
    )


def _query_of(wanted: InferenceRequest, reference: str) -> ClassifyQuery:
    stated = {name: v for name, v in wanted.parameters.items() if name != "binary_data_output"}
    try:
        if "model" in stated:
            raise ParameterError(
                "The parameter model is stated in the address.", remedy="Leave it out."
            )
        return ClassifyQuery.model_validate({**stated, "model": reference})
    except ValidationError as error:
        first = error.errors(include_input=False, include_url=False)[0]
        name = str(first["loc"][0])[:80] if first["loc"] else "parameters"
        raise ParameterError(
            f"The parameter {name}: {first['msg'][:200]}.",
            remedy="Use the parameters of /v1/classify, with their values.",
            details={"option": name},
        ) from None


async def _text(sent: InputTensor) -> AsyncIterator[bytes]:
    for text in sent.data or ():
        yield text.encode("utf-8", "surrogatepass")


def _answer_of(wanted: InferenceRequest, model: ChosenModel, result: Classification) -> Response:
    values: dict[str, tuple[str, list[str] | list[float]]] = {
        "label": ("BYTES", [result.label or ""]),
        "probabilities": ("FP64", result.probabilities.tolist()),
        "class_set": ("BYTES", list(result.class_set)),
    }
    in_binary = wanted.parameters.get("binary_data_output") is True
    chosen = wanted.outputs or [RequestedOutput.model_validate({"name": name}) for name in OUTPUTS]
    outputs = []
    for one in chosen:
        datatype, data = values[one.name]
        about = {"name": one.name, "datatype": datatype, "shape": [len(data)]}
        outputs.append((about, data, one.parameters.get("binary_data", in_binary)))
    head: dict[str, object] = {"model_name": model.name, "model_version": str(model.version)}
    if wanted.id is not None:
        head["id"] = wanted.id
    body, length = binary_body(head, outputs)
    if length is None:
        return Response(body, media_type=JSON)
    return Response(body, media_type=RAW, headers={HEADER: str(length)})


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
            TensorMetadata(name="class_set", datatype="BYTES", shape=[-1]),
        ],
    )
