"""What stands in a form beside its file or its files."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from fastapi.exceptions import RequestValidationError
from starlette.datastructures import FormData, UploadFile

from modalmotion.errors import LimitError, MalformedFileError, ParameterError
from modalmotion.facts import column_of, facts_from_texts, is_fact
from modalmotion_service.http.manifest import MANIFEST, entries_by_name
from modalmotion_service.http.many_files import FILES, ManyFiles, SentPart
from modalmotion_service.work.upload import Part
from modalmotion_service.workspace.spool import SpoolFile

_MOST_BYTES: Final = 4_000_000


def fields_of(form: FormData, names: tuple[str, ...], *, takes_facts: bool) -> dict[str, str]:
    """Read the fields of a form beside its file: facts by the names that columns of tables have.

    Raises
    ------
    RequestValidationError
        If one is not known here: it would be dropped.
    ParameterError
        If one is stated twice.
    """
    texts: dict[str, str] = {}
    n_files = 0
    for heading, value in form.multi_items():
        name = column_of(heading)
        if heading == FILES and isinstance(value, SentPart):
            continue
        if heading == MANIFEST and heading in names and isinstance(value, UploadFile):
            continue
        if heading == "file" and isinstance(value, UploadFile) and FILES not in form:
            n_files += 1
            if n_files > 1:
                raise ParameterError(
                    "The form has two parts 'file'.",
                    remedy=f"Send one, or many as parts named '{FILES}' where a call takes many.",
                )
            continue
        if not isinstance(value, str) or not ((takes_facts and is_fact(name)) or name in names):
            may_be = ", ".join(["file", *names])
            and_facts = " and facts" if takes_facts else ""
            raise RequestValidationError(
                [
                    {
                        "type": "misplaced",
                        "loc": ("form", heading[:80]),
                        "msg": f"A form has {may_be}{and_facts}; all else stands in the query, as "
                        f"?{heading[:80]}=...",
                    }
                ]
            )
        if name in texts:
            raise ParameterError(
                f"The form has two fields '{name[:80]}'.", remedy="Send one of them."
            )
        texts[name] = value
    return texts


async def spool_file_of(form: FormData, many: ManyFiles) -> SpoolFile:
    """Give many files of a form as one of the spool, each with what is stated of it.

    Facts that stand in the form are those of all; a manifest's go over them.

    Raises
    ------
    RequestValidationError
        If a field is not known here.
    ParameterError
        If the manifest names a file that was not sent, or not one that was.
    MalformedFileError
        If the manifest cannot be read.
    """
    texts = fields_of(form, (MANIFEST,), takes_facts=True)
    facts = facts_from_texts({name: texts[name] for name in texts if is_fact(name)})
    parts = tuple(Part(one.name, one.start, one.length, facts=facts) for one in many.parts)
    table = texts.get(MANIFEST)
    described = form.get(MANIFEST)
    if isinstance(described, UploadFile):
        data = await described.read(_MOST_BYTES + 1)
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
    return SpoolFile(many.path, parts=parts if table is None else _described(parts, table))


def _described(parts: tuple[Part, ...], table: str) -> tuple[Part, ...]:
    entries = entries_by_name(table)
    names = [part.name for part in parts]
    unknown = next((name for name in entries if name not in names), None)
    if unknown is not None:
        raise ParameterError(
            f"The manifest names '{unknown[:80]}', and no file of that name was sent.",
            remedy="Send it as a part named 'files' with that file name.",
        )
    for name in names:
        if name not in entries or names.count(name) > 1:
            what = "is not in the manifest" if name not in entries else "was sent twice"
            raise ParameterError(
                f"The file '{name[:80]}' {what}.",
                remedy="Give each file a line of its own under its own name.",
            )
    return tuple(
        replace(
            part,
            subject=entries[part.name].subject,
            label=entries[part.name].label,
            facts=entries[part.name].facts.over(part.facts),
        )
        for part in parts
    )
