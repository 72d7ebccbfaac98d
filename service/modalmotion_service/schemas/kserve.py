"""The open inference protocol (KServe v2): health, metadata of models, inference."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field

from modalmotion_service.schemas.fields import JsonBody


class ServerMetadata(BaseModel):
    """Which server this is."""

    name: str
    version: str
    extensions: list[str] = Field(description="binary_tensor_data.")


class ServerLive(BaseModel):
    """Whether the process runs."""

    live: bool


class ServerReady(BaseModel):
    """Whether it can serve."""

    ready: bool


class ModelReady(BaseModel):
    """Whether a model can be used."""

    model_config = ConfigDict(protected_namespaces=())

    name: str
    ready: bool


class TensorMetadata(BaseModel):
    """An input or output; -1 stands for any size."""

    name: str
    datatype: Literal["BYTES", "FP64"]
    shape: list[int]


class ModelMetadata(BaseModel):
    """Inputs and outputs of a model."""

    name: str
    versions: list[str]
    platform: str
    inputs: list[TensorMetadata]
    outputs: list[TensorMetadata]


OUTPUTS: Final = ("label", "probabilities", "class_set")
"""Names of all outputs."""

# Elements that are sent: the file.
_ONE: Final = 1


class InputTensor(JsonBody):
    """The file of a sequence: a tensor of one element."""

    name: Literal["sequence"]
    datatype: Literal["BYTES"]
    shape: list[Literal[1]] = Field(min_length=_ONE, max_length=_ONE, description="[1]")
    parameters: dict[Literal["binary_data_size"], Annotated[int, Field(ge=4)]] = Field(
        default_factory=dict,
        description="binary_data_size: bytes of the tensor behind the JSON, of which the first "
        "four say how long the file is.",
    )
    data: list[str] | None = Field(
        None, min_length=_ONE, max_length=_ONE, description="A file that is text, such as CSV."
    )


class RequestedOutput(JsonBody):
    """An output that is wanted."""

    name: Literal["label", "probabilities", "class_set"]
    parameters: dict[Literal["binary_data"], bool] = Field(
        default_factory=dict, description="binary_data: whether it comes in binary."
    )


class InferenceRequest(JsonBody):
    """A file, and what is wanted of it."""

    id: str | None = Field(None, max_length=200, description="Given back.")
    parameters: dict[str, Any] = Field(
        default_factory=dict,
        description="binary_data_output: whether all outputs come in binary; others are those of "
        "/v1/classify, such as coverage, unit and topology.",
    )
    inputs: Annotated[list[InputTensor], FailFast()] = Field(min_length=_ONE, max_length=_ONE)
    outputs: Annotated[list[RequestedOutput], FailFast()] = Field(
        default_factory=list, max_length=len(OUTPUTS), description="All by default."
    )


class OutputTensor(BaseModel):
    """An output of a model."""

    name: str
    datatype: Literal["BYTES", "FP64"]
    shape: list[int]
    data: list[str] | list[float] | None = Field(None, description="Where it is not binary.")
    parameters: dict[str, int] | None = Field(None, description="binary_data_size.")


class InferenceAnswer(BaseModel):
    """Answer of a model: label (empty where it abstains), probabilities and class set."""

    model_config = ConfigDict(protected_namespaces=())

    model_name: str
    model_version: str
    id: str | None = None
    outputs: list[OutputTensor]
