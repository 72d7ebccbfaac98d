"""Command that fits signatures of many recordings, in processes here or on a Dask scheduler."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import click
import numpy as np

from modalmotion import errors, formats
from modalmotion.classification.manifest import LabelledFile, labelled_files
from modalmotion.classification.training import joblib_backend
from modalmotion.cli import shared
from modalmotion.cli.files import progress_bar, sequence_argument, stated_facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topologies import MESH, SPHERE
from modalmotion.representation import csv_text
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.tracking.recordings import sequence_of

if TYPE_CHECKING:
    from modalmotion.store import ResultStore, SequenceRecord

_TABLE: Final = "cohort.csv"
_COLUMNS: Final = (
    *("path", "stamp", "settings", "key", "sequence_id", "kind", "rms_error", "unit", "error"),
)
# Tables, texts and pictures lie beside sequences: simulate-cohort writes its table so.
_NO_SEQUENCES: Final = (".csv", ".tsv", ".json", ".txt", ".md", ".png", ".svg", ".pdf", ".log")
_MOST_PRINTED: Final = 50


_Row = dict[str, Any]
_Made = tuple[bytes, "SequenceRecord", ModalSignature]
"""Vertices, record and signature of a recording."""


@shared.command("cohort cases.csv -o results --workers 8")
@sequence_argument
@shared.fit_options
def cohort(
    source: Path,
    output: Annotated[Path, shared.OutputFolder()],
    workers: Annotated[int | None, click.IntRange(1, 256)] = None,
    scheduler: str | None = None,
    keep_vertices: bool = False,
    skip_unreadable: bool = False,
    **options: Any,
) -> Any:
    """Fit a signature to every recording of a manifest, and store the results.

    FILE is a manifest (.csv; path and, if known, label, subject and facts) or a folder. A path in a
    manifest may be a URL, such as s3://bucket/beat.npz. After an interruption, the same command
    continues with what is missing. `modalmotion store export` packs the results.

    Parameters
    ----------
    output
        Folder of results; made if missing, continued if not.
    workers
        Processes; one for each core.
    scheduler
        Dask scheduler to send work to, such as tcp://host:8786.
    keep_vertices
        Keep the sequences too, not only results.
    skip_unreadable
        Files that fail do not make the command fail.
    """
    from modalmotion.store import ResultStore, write_atomic

    parameters = shared.signature_parameters(options)
    files = _files(source)
    if not files:
        raise errors.ParameterError(f"'{source}' names no recording.", remedy="Check it.")
    counts = {"n_made": 0, "n_known": 0}
    with ResultStore(output, keep_uploads=keep_vertices) as store:
        work = partial(_rows, store, options, counts)
        with joblib_backend(scheduler, workers or -1):
            rows = work(files, parameters)
            # Recordings of one mesh have one kind of modes: closed ones that their shape alone made
            # spheres have springs where others of their mesh do.
            kinds = {row["kind"] for row in rows}
            meshes = {kind.partition(" ")[2] for kind in kinds if kind.startswith(f"{MESH} ")}
            spheres = [
                (number, file)
                for number, (file, row) in enumerate(zip(files, rows, strict=True))
                if row["kind"] in {f"{SPHERE.name} {mesh}" for mesh in meshes}
            ]
            springs = replace(parameters, topology=MESH)
            again = work([file for _, file in spheres], springs)
            for (number, _), row in zip(spheres, again, strict=True):
                rows[number] = row
    table = csv_text([_COLUMNS, *([row[name] for name in _COLUMNS] for row in rows)])
    write_atomic(output / _TABLE, table.encode())
    failures = [[row["path"], row["error"]] for row in rows if row["error"]]
    answer = {**counts, "failures": failures}
    for path, error in failures[:_MOST_PRINTED]:
        click.echo(f"{path}: {error}", err=True)
    fails = failures and not skip_unreadable
    said = shared.described({**answer, "failures": len(failures), "table": output / _TABLE})
    return answer, said, click.exceptions.Exit(1) if fails else None


def _rows(
    store: ResultStore,
    stated: dict[str, Any],
    counts: dict[str, int],
    files: list[LabelledFile],
    parameters: SignatureParameters,
) -> list[_Row]:
    """Fit what the store does not know, wherever joblib works; gives a row for each file."""
    from joblib import Parallel, delayed

    from modalmotion.store import UNSET

    table, keeps = store.root / _TABLE, store.keep_uploads
    done = _known(table, store, parameters.key)
    left = [file for file in files if (_name(file), _stamp(file)) not in done]
    counts["n_known"] += len(files) - len(left)
    work = (delayed(_signed)(file, parameters, stated, keeps) for file in left)
    failed: dict[str, _Row] = {}
    with (
        progress_bar(length=len(left), label="signatures") as bar,
        table.open("a", newline="") as lines,
    ):
        for row, made in Parallel(return_as="generator_unordered")(work) if left else ():
            if made is not None:
                vertices, record, signature = made
                store.put_sequence_image(vertices, record)
                store.put_signature(signature)
                done[row["path"], row["stamp"]] = row
                counts["n_made"] += 1
            else:
                failed[row["path"]] = row
            csv.DictWriter(lines, _COLUMNS).writerow(row)
            lines.flush()
            bar.update(1)
    of_paths = {path: row for (path, _), row in done.items()} | failed
    for file in files:
        if sequence_id := of_paths[_name(file)]["sequence_id"]:
            # What the manifest says now.
            store.update_sequence(
                sequence_id, subject=file.subject or UNSET, label=file.label or UNSET
            )
    return [of_paths[_name(file)] for file in files]


def _files(source: Path) -> list[LabelledFile]:
    if not source.is_dir():
        return labelled_files([source], skip_unreadable=True, needs_label=False)
    paths = sorted(p for p in source.iterdir() if p.suffix.lower() not in _NO_SEQUENCES)
    return [LabelledFile(path, "", None) for path in paths if path.name[0] != "."]


def _name(file: LabelledFile) -> str:
    return file.url or str(file.path.absolute())


def _stamp(file: LabelledFile) -> str:
    """Return a text that changes with the file or the facts it is read with; reads no content."""
    with contextlib.suppress(OSError):
        status = file.path.stat()
        return f"{status.st_size} {status.st_mtime_ns} {file.facts}"
    return f"{file.facts}"


def _signed(
    file: LabelledFile, parameters: SignatureParameters, stated: dict[str, Any], keeps: bool
) -> tuple[_Row, _Made | None]:
    """Fit one signature, in a process of joblib; an error costs this file alone."""
    from modalmotion.store import record_of, upload_image

    row: _Row = dict.fromkeys(_COLUMNS, "")
    # The stamp is that of the file as it was read.
    row |= {"path": _name(file), "stamp": _stamp(file), "settings": parameters.key}
    try:
        with _here(file) as path:
            stated = {**stated}
            options = formats.ReadOptions(facts=stated_facts(stated).over(file.facts), **stated)
            sequence = sequence_of(path, options)
        signature = modal_signature(sequence, parameters)
    except errors.ModalMotionError as error:
        return {**row, "error": str(error)}, None
    except OSError as error:
        # What a URL's query says may be secret.
        return {**row, "error": f"it cannot be fetched: {type(error).__name__}"}, None
    row |= {"key": signature.parameters.key, "sequence_id": signature.sequence_id}
    row |= {"rms_error": signature.rms_error, "unit": signature.unit or ""}
    row["kind"] = _kind_by_shape(sequence, signature)
    record = record_of(sequence, created="", has_upload=keeps)
    return row, (upload_image(sequence) if keeps else b"", record, signature)


@contextlib.contextmanager
def _here(file: LabelledFile) -> Iterator[Path]:
    """Give a path of this machine, of a copy that goes with the block if the file has a URL."""
    if file.url is None:
        yield file.path
        return
    with errors.needs_extra("remote"):
        import fsspec
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / file.path.name
        with fsspec.open(file.url, "rb") as there, path.open("wb") as here:
            shutil.copyfileobj(there, here)
        yield path


def _known(table: Path, store: ResultStore, settings: str) -> dict[tuple[str, str], _Row]:
    """Read what earlier runs have done with these parameters, and what the store still has."""
    known = {}
    with contextlib.suppress(OSError), table.open(newline="") as lines:
        for row in csv.DictReader(lines, _COLUMNS):
            with contextlib.suppress(errors.ModalMotionError, TypeError):
                is_there = store.sound_signature_path(row["sequence_id"], row["key"]) is not None
                if row["settings"] == settings and is_there:
                    known[row["path"], row["stamp"]] = row
    return known


def _kind_by_shape(sequence: MeshSequence, signature: ModalSignature) -> str:
    """Give the kind of modes that a closed surface has by its shape alone, and its mesh."""
    if sequence.topology is not None or signature.parameters.fixes_kind:
        return ""
    if signature.surface not in (SPHERE.name, MESH):
        return ""
    digest = hashlib.sha256(str(sequence.n_vertices).encode())
    digest.update(np.ascontiguousarray(sequence.faces, dtype="<i8").data)
    return f"{signature.surface} {digest.hexdigest()[:16]}"
