"""Uploads: a file, or many, and what is stated of it in the query, in a form, or as JSON in one.

And signatures, classes and streams of files that are sent with the request; nothing is stored.
"""

import asyncio
import hashlib
from collections import Counter
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import Depends, Request, Response
from pydantic_core import from_json
from starlette.datastructures import FormData, QueryParams

from modalmotion.classification.manifest import Row, manifest_rows
from modalmotion.errors import LimitError, MalformedFileError, ParameterError
from modalmotion.mesh.fact_forms import column_of, facts_from_texts, is_fact
from modalmotion.mesh.facts import NAMES, NO_FACTS, Facts
from modalmotion.store.folders import require_name
from modalmotion_service.http.forms import FILES, MANIFEST, FormFiles, SentPart, received_form
from modalmotion_service.http.gated_router import GatedRouter, checked, described_as, invalid
from modalmotion_service.http.negotiation import JSON, NDJSON, NPZ, RAW, STREAM, VTKHDF
from modalmotion_service.http.observation import stage
from modalmotion_service.routes.asked import Asked, AskedAny, answers, get_state
from modalmotion_service.schemas import queries, results, signatures
from modalmotion_service.schemas.from_core import JsonBody, is_listed
from modalmotion_service.schemas.requests import CLASS_OF_FILE, ENCODING_OF_FILE, SIGNATURE_OF_FILE
from modalmotion_service.work.upload import Part
from modalmotion_service.workspace import file_operations as operations
from modalmotion_service.workspace import models
from modalmotion_service.workspace.operation import Operation, State
from modalmotion_service.workspace.operation import Request as Requested
from modalmotion_service.workspace.signature_operations import SIGNATURE_TYPES
from modalmotion_service.workspace.spool import SpoolFile

PARAMETERS: Final = "parameters"
"""Name of the part that has statements as JSON."""

_MOST_BYTES: Final = 4_000_000


@dataclass(frozen=True)
class Sent:
    """An upload with what is stated of it; a `with` block of the file removes it in the end.

    Parameters
    ----------
    file : SpoolFile
        With its facts.
    query : JsonBody
        All other statements.
    """

    file: SpoolFile
    query: Any


def receiving(
    model: type[JsonBody], *, takes_many: bool = False, is_optional: bool = False
) -> Callable[[Request], Awaitable[Sent]]:
    """Make the dependency that receives an upload into the spool.

    Parameters
    ----------
    model : type of JsonBody
        Of what may be stated of it.
    takes_many : bool
        Whether it may be parts named "files", each a sequence, and a part named "manifest" that
        describes them.
    is_optional : bool
        Whether something else may be in place of a file.
    """

    async def receive(request: Request) -> Sent:
        state = await get_state(request)
        with stage("receive"):
            sent = await _receive(request, state, model, takes_many=takes_many)
        # Handlers remove their upload; one that is never called because its query is not valid
        # cannot.
        request.state.remove_upload = sent.file.remove
        return sent

    receive.query_model = model  # type: ignore[attr-defined]
    receive.described = _description(  # type: ignore[attr-defined]
        model, takes_many=takes_many, is_optional=is_optional
    )
    return receive


def _description(model: type[JsonBody], *, takes_many: bool, is_optional: bool) -> dict[str, Any]:
    """Describe an upload with statements in the query, in fields of a form, or as JSON in it."""
    stated = described_as(model)
    file = {"type": "string", "format": "binary"}
    form: dict[str, Any] = {"type": "object", "properties": {"file": file, PARAMETERS: stated}}
    if takes_many:
        many = {FILES: {"type": "array", "items": file}, MANIFEST: {"type": "string"}}
        form["properties"] |= many
    elif not is_optional:
        form["required"] = ["file"]
    encoding = {PARAMETERS: {"contentType": JSON}}
    query = {
        "name": PARAMETERS,
        "in": "query",
        "required": False,
        "style": "form",
        "explode": True,
        "schema": stated,
        "description": "Each by its name, over those of a form; a list as 1,2,3.",
    }
    content = {
        RAW: {"schema": file},
        "multipart/form-data": {"schema": form, "encoding": encoding},
    }
    body = {"required": not is_optional, "content": content}
    return {"requestBody": body, "parameters": [query]}


async def _receive(
    request: Request, state: State, model: type[JsonBody], *, takes_many: bool
) -> Sent:
    # Only requests with an idempotency key are compared by their hash.
    hashed = "idempotency-key" in request.headers
    kind = request.headers.get("content-type", "").lower()
    if not kind.startswith("multipart/form-data"):
        query, facts = statements(model, _texts(request.scope["query_string"], model))
        file = await state.spool.receive(request.stream(), hashed=hashed)
        return Sent(replace(file, facts=facts), query)
    # Before the form is received, not after.
    state.spool.require_reserve()
    most = state.settings.max_batch_files if takes_many else 0
    files = FormFiles(state.spool.new_path(), most)
    async with received_form(request, files) as form:
        stated = fields_of(form, model, takes_many=bool(files.many))
        table = stated.pop(MANIFEST, None)
        query, facts = statements(model, stated | _texts(request.scope["query_string"], model))
        if files.many:
            return Sent(_file_of_many(form, files, facts, table), query)
        if "file" not in form:
            raise MalformedFileError(
                "The form has no file part named 'file'.",
                remedy="Send one part named 'file', or the bytes as the raw body.",
            )
        digest = await asyncio.to_thread(_digest, files.path) if hashed else ""
        return Sent(SpoolFile(files.path, digest, facts), query)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _texts(query: bytes, model: type[JsonBody]) -> dict[str, Any]:
    """Read a query as values: lists as 1,2,3, as JSON, or by a name that comes again."""
    values: dict[str, Any] = {}
    params = QueryParams(query)
    for name in params:
        if name != "wait":
            texts = params.getlist(name)
            values[name] = texts if len(texts) > 1 else of_text(model, name, texts[0])
    return values


def of_text(model: type[JsonBody], name: str, text: str) -> Any:
    """Read a text as the value of a member of a model."""
    if _is_fact_of(model, name) or name not in model.model_fields:
        return text
    hint = model.model_fields[name].annotation
    if text.startswith(("[", "{")):
        try:
            return from_json(text)
        except ValueError:
            return text  # Which its model refuses by name.
    if is_listed(hint):
        return text.split(",")
    # Where a number is the default, this is how to say none.
    return None if text == "none" and hint == int | None else text


def _is_fact_of(model: type[JsonBody], name: str) -> bool:
    """Whether a name states a fact that a model has, and does not read itself."""
    if not is_fact(name) or name in model.own_names:
        return False
    return (name if name in NAMES else f"{name.partition(':')[0]}s") in model.model_fields


def statements(model: type[JsonBody], values: Mapping[str, Any]) -> tuple[JsonBody, Facts]:
    """Check what is stated of an upload; gives the facts apart that a call does not read itself.

    Raises
    ------
    RequestValidationError
        If something is not known, or does not fit.
    ParameterError
        If a fact does not.
    """
    facts = {name: value for name, value in values.items() if _is_fact_of(model, name)}
    rest = {name: value for name, value in values.items() if name not in facts}
    return checked(model, rest, "query"), facts_from_texts(facts) if facts else NO_FACTS


def fields_of(form: FormData, model: type[JsonBody], *, takes_many: bool) -> dict[str, Any]:
    """Read the fields of a form beside its file: statements by name, and those in a part of JSON.

    Raises
    ------
    RequestValidationError
        If one is not known here: it would be dropped.
    ParameterError
        If one is stated twice.
    """
    values: dict[str, Any] = {}
    whole: dict[str, Any] = {}
    # Of these the second may be a field too.
    own = (FILES, MANIFEST) if takes_many else ("file",)
    for heading in form:
        name, found = column_of(heading), form.getlist(heading)
        texts = [one for one in found if isinstance(one, str)]
        is_file = heading in own and not texts
        is_known = heading == PARAMETERS or name in model.model_fields or name in own[1:]
        if not is_file and (len(texts) < len(found) or not (is_known or _is_fact_of(model, name))):
            names = f"file, {PARAMETERS} and the names that /docs has for this call"
            raise invalid(f"A form has {names}, not {heading[:80]}", "form", heading)
        if name in values or (len(found) > 1 and not (is_file and heading == FILES)):
            raise ParameterError(
                f"The form has several parts '{heading[:80]}'.",
                remedy=f"Send one, or many as parts named '{FILES}' where a call takes many.",
            )
        if heading == PARAMETERS:
            whole = _object(texts[0])
        elif not is_file:
            values[name] = of_text(model, name, texts[0])
    return values | whole


def _object(text: str) -> dict[str, Any]:
    try:
        value = from_json(text, allow_inf_nan=False)
    except ValueError:
        value = None
    if not isinstance(value, dict):
        raise ParameterError(
            f"The part '{PARAMETERS}' is no JSON object.", remedy='Send one such as {"modes": 7}.'
        )
    return value


def _file_of_many(form: FormData, files: FormFiles, facts: Facts, table: str | None) -> SpoolFile:
    """Give many files of a form as one of the spool, each with what is stated of it.

    Facts that are in the form are those of all; a manifest's go over them.

    Raises
    ------
    ParameterError
        If the manifest names a file that was not sent, or not one that was.
    MalformedFileError
        If the manifest cannot be read.
    """
    parts = tuple(Part(one.name, one.start, one.length, facts=facts) for one in files.many)
    described = form.get(MANIFEST)
    if isinstance(described, SentPart):
        data = files.read(described, _MOST_BYTES + 1)
        if len(data) > _MOST_BYTES:
            raise LimitError(
                f"The manifest is larger than {_MOST_BYTES} bytes.",
                remedy="Send the files in several requests.",
                details={"most": _MOST_BYTES},
            )
        try:
            table = data.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise MalformedFileError(
                f"The manifest is not UTF-8 text (byte {error.start}).",
                remedy="Save the table as UTF-8 (in Excel: CSV UTF-8).",
            ) from error
    return SpoolFile(files.path, parts=parts if table is None else _described(parts, table))


def _described(parts: tuple[Part, ...], table: str) -> tuple[Part, ...]:
    rows = list(manifest_rows(table, MANIFEST))
    listed, sent = Counter(row.path for row in rows), Counter(part.name for part in parts)
    for name in listed | sent:
        if listed[name] != 1 or sent[name] != 1:
            raise ParameterError(
                f"The file '{name[:80]}' is {listed[name]} times in the manifest, and was sent "
                f"{sent[name]} times.",
                remedy=f"Send each file as a part '{FILES}', and give it a line of its own under "
                "its file name.",
            )
    by_name = {row.path: row for row in rows}
    return tuple(_stated(part, by_name[part.name]) for part in parts)


def _stated(part: Part, row: Row) -> Part:
    for name in ("subject", "label"):
        try:
            require_name(name, getattr(row, name))
        except ParameterError as error:
            error.message = f"Line {row.line} of '{MANIFEST}': {error.message}"
            raise
    facts = row.facts.over(part.facts)
    return replace(part, subject=row.subject, label=row.label, facts=facts)


router = GatedRouter(prefix="/v1", tags=["files"])


@router.post(
    "/signature",
    **answers(*SIGNATURE_TYPES, NDJSON, of=signatures.SignatureAnswer | results.SignatureResults),
)
async def sign_file(
    sent: Annotated[Sent, Depends(receiving(SIGNATURE_OF_FILE, takes_many=True))], asked: AskedAny
) -> Response:
    """Give the signature of a file; nothing is stored.

    As JSON, HDF5, npz, a table, a picture, or the amplitudes alone as little-endian float32 (frame
    by frame, mode by mode, three directions), by `Accept`.

    Of many files, sent as parts `files` of a form: a result or a problem for each, in their order,
    as JSON or a line of it each. A part `manifest`, a CSV table with the columns path, subject,
    label and facts, says those of each.
    """
    return await _answered(asked, sent, operations.sent_signature, operations.sent_signatures)


@router.post(
    "/classify",
    **answers(JSON, NDJSON, of=results.UploadClassificationAnswer | results.ClassificationResults),
)
async def classify_file(
    sent: Annotated[Sent, Depends(receiving(CLASS_OF_FILE, takes_many=True))], asked: AskedAny
) -> Response:
    """Name the class of the motion in a file; nothing is stored.

    Of many files, sent as parts `files` of a form: a class or a problem for each, in their order,
    as JSON or a line of it each.
    """
    with sent.file:
        await asyncio.to_thread(models.choose, asked.state, sent.query.model)
        return await _answered(
            asked, sent, operations.sent_classification, operations.sent_classifications
        )


@router.post("/encode", **answers(STREAM))
async def encode_file(
    sent: Annotated[Sent, Depends(receiving(ENCODING_OF_FILE))], asked: AskedAny
) -> Response:
    """Compress a file at an error you choose; nothing is stored.

    Size and errors of the stream are in the headers Encoded-...
    """
    return await _answered(asked, sent, operations.sent_encoding)


@router.post("/decode", **answers(NPZ, VTKHDF, RAW))
async def decode_file(
    sent: Annotated[Sent, Depends(receiving(queries.DecodingRequest))], asked: AskedAny
) -> Response:
    """Decode a stream, or some of its frames; nothing is stored."""
    with sent.file:
        return await _answered(asked, sent, operations.decoding)


async def _answered(
    asked: Asked, sent: Sent, of_one: Operation, of_many: Operation | None = None
) -> Response:
    with sent.file as file:
        what = of_many if of_many is not None and file.parts else of_one
        kind = asked.media_type(*what.media_types)
        return await asked.do(what, Requested(query=sent.query, media_type=kind), file=file)
