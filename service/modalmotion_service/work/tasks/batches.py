"""Signatures of many files that were sent together, in one file."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.exports.signature_pack import write_pack
from modalmotion.exports.tables import Recording, Table, cohort_table
from modalmotion.signature.making import ModalSignature
from modalmotion.store import SequenceRecord, signature_from_hdf5
from modalmotion_service.work.tasks.files import whole_file
from modalmotion_service.work.upload import Part

RESULTS: Final = "results.json"
"""Member of an archive that says which file, or which problem, each result is."""


def pack_archive(archive: Path, parts: Sequence[Part], output: Path) -> None:
    """Pack the signatures of an archive into one HDF5 file, laid out as an export.

    Its group `files` tells of each file that was sent, in order, its `name`, the `sequence_id` by
    which its rows are found, and the `problem` as JSON where there is no signature.
    """
    import h5py

    results, ids = _results(archive), {}

    def read() -> Iterator[tuple[ModalSignature, SequenceRecord]]:
        for number, signature in _signatures(archive, results):
            part = parts[number]
            ids[number] = signature.sequence_id
            yield signature, _record(signature, part)

    with whole_file(output) as temporary:
        write_pack(temporary, read())
        with h5py.File(temporary, "a") as file:
            group = file.create_group("files")
            columns = {
                "name": [result["name"] for result in results],
                "sequence_id": [ids.get(number, "") for number in range(len(results))],
                "problem": [
                    "" if result["error"] is None else json.dumps(result["error"])
                    for result in results
                ],
            }
            for name, texts in columns.items():
                data = np.array(texts, dtype=object)
                group.create_dataset(name, data=data, dtype=h5py.string_dtype())


def tabulate_archive(archive: Path, parts: Sequence[Part], output: Path) -> None:
    """Write a table of the signatures of an archive: a row a file, those that failed at the end."""
    results = _results(archive)
    table = cohort_table(
        Recording(
            parts[number].name,
            signature,
            subject=parts[number].subject,
            label=parts[number].label,
        )
        for number, signature in _signatures(archive, results)
    )
    failed = [(one["name"], one["error"]) for one in results if one["error"] is not None]
    with whole_file(output) as temporary:
        temporary.write_bytes(_with_failures(table, failed).to_csv().encode())


def _results(archive: Path) -> list[Mapping[str, Any]]:
    with zipfile.ZipFile(archive) as file:
        results: list[Mapping[str, Any]] = json.loads(file.read(RESULTS))["results"]
        return results


def _signatures(
    archive: Path, results: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[int, ModalSignature]]:
    with zipfile.ZipFile(archive) as file:
        for number, result in enumerate(results):
            if result["file"] is not None:
                yield number, signature_from_hdf5(file.read(result["file"]))


def _record(signature: ModalSignature, part: Part) -> SequenceRecord:
    return SequenceRecord(
        id=signature.sequence_id,
        n_frames=signature.n_frames,
        n_vertices=signature.n_vertices,
        n_faces=0,
        topology=None,
        grid=None,
        unit=signature.unit,
        has_times=signature.times is not None,
        subject=part.subject,
        label=part.label,
        created="",
        has_upload=False,
    )


def _with_failures(table: Table, failed: Sequence[tuple[str, Mapping[str, Any]]]) -> Table:
    columns = {"recording": np.array([], dtype=object), **table.columns}
    n = len(columns["recording"])
    whole: dict[str, np.ndarray[Any, Any]] = {}
    for name, column in columns.items():
        blank = "" if column.dtype.kind == "U" else np.nan
        rest = [one for one, _ in failed] if name == "recording" else [blank] * len(failed)
        whole[name] = np.array([*column.tolist(), *rest], dtype=object)
    errors = [*[""] * n, *(str(error["detail"]) for _, error in failed)]
    whole["error"] = np.array(errors, dtype=object)
    return Table(whole)
