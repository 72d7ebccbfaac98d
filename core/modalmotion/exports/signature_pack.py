"""All signatures of a store in one HDF5 file, for analysis."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from modalmotion import errors, formats
from modalmotion.hdf5.image import Form
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.scales import lengths
from modalmotion.progress import Reporter, reported
from modalmotion.representation import Array, Floats
from modalmotion.signature import hdf5, making, reconstruction
from modalmotion.store.disk import write_atomic
from modalmotion.template import Template

if TYPE_CHECKING:
    from modalmotion.store.folders import SequenceRecord

    Packed = tuple[making.ModalSignature, SequenceRecord]

FORM: Final = Form("export", 3)


class _Column(NamedTuple):
    """One dataset of a group: rows of each signature, its unit ("*" for that of lengths)."""

    name: str
    rows: Callable[[making.ModalSignature, SequenceRecord], Any]
    unit: str
    axes: str


def _by_frame(name: str) -> _Column:
    return _Column(name, lambda s, _: getattr(s, name), "*", "frame")


_AXES: Final = "frame, mode, direction"
_COLUMNS: Final = (
    _Column("amplitudes", lambda s, _: s.amplitudes, "*", _AXES),
    _Column(
        *("amplitude_deviations", lambda s, _: _or_nan(s.amplitude_deviations, s.amplitudes)),
        *("*", _AXES),
    ),
    _Column("times", lambda s, _: _or_nan(s.times, s.rms_errors), "s", "frame"),
    _Column("rotation_matrices", lambda s, _: s.rotations.matrices, "1", "frame, row, column"),
    _Column("translations", lambda s, _: s.translations, "*", "frame, direction"),
    *map(_by_frame, ("rms_errors", "weighted_rms_errors", "p95_errors", "max_errors")),
    *map(_by_frame, ("motion_rms", "weighted_motion_rms")),
    _Column("n_frames", lambda s, _: [s.n_frames], "1", "signature"),
    _Column("n_vertices", lambda s, _: [s.n_vertices], "1", "signature"),
    _Column("condition", lambda s, _: [s.condition], "1", "signature"),
    _Column("lengths", lambda s, _: [s.lengths], "*", "signature, axis"),
    _Column(
        *("angular_frequencies", lambda s, _: [s.angular_frequencies], "rad/s"),
        "signature, mode",
    ),
    _Column("sequence_id", lambda s, _: [s.sequence_id], "none", "signature"),
    _Column("template_id", lambda s, _: [s.template_id], "none", "signature"),
    _Column("subject", lambda _, r: [r.subject or ""], "none", "signature"),
    _Column("label", lambda _, r: [r.label or ""], "none", "signature"),
)


@dataclass(frozen=True)
class PackReport:
    """Outcome of an export.

    Parameters
    ----------
    n_signatures : int
        Packed.
    failures : tuple of (str, str)
        Sequence and reason of each signature that cannot be read as written.
    """

    n_signatures: int
    failures: tuple[tuple[str, str], ...] = ()


def export(root: Path, out: Path, *, progress: Reporter | None = None) -> PackReport:
    """Pack the trajectories of all signatures of a store into one HDF5 file.

    Signatures with the same parameters, modes and unit form a group; their frames follow one
    another, and `n_frames` says how many belong to each. A damaged signature is left out: the
    report names it. Needs the memory that the file takes on disk.

    Parameters
    ----------
    root : Path
    out : Path
        Must not exist.
    progress : callable, optional

    Returns
    -------
    PackReport

    Raises
    ------
    NotFoundError
        If the store does not exist, or has no signatures; no file is written then.
    CorruptFileError
        If all of them are damaged.
    StoreError
        If `out` exists or cannot be written, or another process has the store open.
    """
    from modalmotion.store import ResultStore, recovery

    recovery.existing_store(root)
    if out.exists():
        raise errors.StoreError(
            f"'{out.name}' exists already.", remedy="Choose another name, or remove it first."
        )
    failures: list[tuple[str, str]] = []
    with ResultStore(root) as store:
        names = store.all_signatures()
        if not names:
            raise errors.NotFoundError(
                f"The store '{store.root.name}' has no signatures to pack.",
                remedy="Fit signatures first: modalmotion signature, or a cohort into this folder.",
            )

        def read() -> Iterator[Packed]:
            for sequence_id, key in reported(names, progress):
                try:
                    pair = store.signature(sequence_id, key), store.sequence_record(sequence_id)
                except (errors.CorruptFileError, errors.NotFoundError) as error:
                    failures.append((sequence_id, str(error)))
                else:
                    yield pair
            if len(failures) == len(names):
                raise errors.CorruptFileError(
                    f"None of {len(names)} signatures can be read as written. {failures[0][1]}"
                )

        write_pack(out, read())
    return PackReport(len(names) - len(failures), tuple(failures))


def write_pack(path: Path, signatures: Iterable[Packed]) -> None:
    """Pack signatures into an HDF5 file as `export` does, without a store.

    Parameters
    ----------
    path : Path
        Replaced if it exists.
    signatures : iterable of (ModalSignature, SequenceRecord)

    Raises
    ------
    StoreError
        If it cannot be written.
    """
    write_atomic(path, _image(signatures))


# Signatures whose rows are in memory at a time.
_AT_ONCE: Final = 500


def _image(signatures: Iterable[Packed]) -> memoryview:
    import h5py

    # By what its signatures have in common (parameters, modes and unit).
    groups: dict[Any, Any] = {}
    waiting: dict[Any, list[Packed]] = {}

    def write_rows() -> None:
        for kind, pairs in waiting.items():
            for column in _COLUMNS:
                values = np.concatenate([np.asarray(column.rows(*pair)) for pair in pairs])
                values = values.astype(h5py.string_dtype()) if values.dtype.kind == "U" else values
                _extend(groups[kind], column, values)
        waiting.clear()

    # In memory, for the HDF5 library does not survive a disk that fills up.
    image = io.BytesIO()
    with h5py.File(image, "w", libver="v110") as file:
        file.attrs.update(FORM.header())
        for number, (signature, record) in enumerate(signatures, 1):
            key, unit = signature.parameters.key, signature.unit or "unknown"
            kind = (key, signature.modes, unit)
            if kind not in groups:
                groups[kind] = group = file.create_group(f"{len(groups):03d}-{key}")
                group.attrs["parameters"] = json.dumps(asdict(signature.parameters), sort_keys=True)
                group.attrs["parameters_key"] = key
                group.attrs["topology"] = signature.surface
                group.attrs["unit"] = unit
                for one in hdf5.mode_datasets(signature.modes):
                    made = group.create_dataset(one.name, data=one.values)
                    made.attrs.update({"unit": one.unit, "axes": one.axes})
            waiting.setdefault(kind, []).append((signature, record))
            if number % _AT_ONCE == 0:
                write_rows()
        write_rows()
    return image.getbuffer()


def _extend(group: Any, column: _Column, values: Array) -> None:
    if column.name in group:
        dataset = group[column.name]
        dataset.resize(len(dataset) + len(values), axis=0)
        dataset[-len(values) :] = values
        return
    # Of any length: there may be no axis at all.
    dataset = group.create_dataset(column.name, data=values, maxshape=(None,) * values.ndim)
    unit = column.unit.replace("*", group.attrs["unit"])
    dataset.attrs.update({"unit": unit, "axes": column.axes})


def _or_nan(values: Floats | None, like: Floats) -> Floats:
    return np.full(like.shape, np.nan) if values is None else values


class SurfaceFormat(StrEnum):
    """Formats that moving surfaces are written in."""

    NPZ = "npz"
    VTKHDF = "vtkhdf"
    GLB = "glb"
    PLY = "ply"


SUFFIXES = {
    ".npz": SurfaceFormat.NPZ,
    ".vtkhdf": SurfaceFormat.VTKHDF,
    ".glb": SurfaceFormat.GLB,
    ".zip": SurfaceFormat.PLY,
}
"""Format by suffix."""


def write_superposed(
    signature: making.ModalSignature,
    sequence: MeshSequence,
    surface_format: SurfaceFormat = SurfaceFormat.NPZ,
    *,
    template: Template | None = None,
    times: Floats | None = None,
    phases: list[float] | int | None = None,
    max_targets: int | None = None,
) -> bytes:
    """Superpose a signature's modes on its reference, and write the surfaces.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from.
    surface_format : SurfaceFormat
        npz, VTKHDF (with the error at each vertex as a field; of phases the deviation), GLB (modes
        as morph targets, amplitudes as their weights), or a zip of PLY files.
    template : Template, optional
        The one that the signature's parameters name, if they name one.
    times : (n,) float64, s, optional
        Those of the frames by default.
    phases : list of float or int, optional
        Instead of times: shares of the cycle, or a number of even steps; see `resample`.
    max_targets : int, optional
        For a GLB: largest number of targets, those with most motion.

    Returns
    -------
    bytes

    Raises
    ------
    ParameterError
        If a time is outside the recording, the sequence is another, or both times and phases
        are chosen, or phases of a GLB.
    """
    if phases is not None and (times is not None or surface_format == SurfaceFormat.GLB):
        raise errors.ParameterError(
            "Phases were given with times, or for a GLB, which has all frames.",
            remedy="Give one of times and phases, and another format for phases.",
        )
    moved = signature if times is None else reconstruction.at_times(signature, times)
    if surface_format == SurfaceFormat.GLB:
        from modalmotion.exports.animation import modal_animation

        return formats.write_glb(modal_animation(moved, sequence, max_targets, template=template))
    positions = reconstruction.reconstruct(moved, sequence, template=template)
    surfaces = replace(sequence, vertices=positions, times=moved.times, uncertainty=None)
    fields = None
    if phases is not None:
        resampled = reconstruction.resample(surfaces, phases)
        surfaces, fields = resampled.sequence, {"deviation": resampled.deviations}
    elif times is None:
        fields = {"error": lengths(positions - sequence.vertices)}
    attributes: dict[str, str | int | float] = {
        "sequence_id": signature.sequence_id,
        "modes": len(signature.modes),
        **signature.provenance,
    }
    return write_surfaces(surfaces, surface_format, fields, attributes)


def write_surfaces(
    surfaces: MeshSequence,
    surface_format: SurfaceFormat,
    fields: Mapping[str, Floats] | None = None,
    attributes: Mapping[str, str | int | float] | None = None,
) -> bytes:
    """Write surfaces frame by frame: npz, VTKHDF with fields and attributes, or a zip of PLY."""
    if surface_format == SurfaceFormat.PLY:
        return formats.write_ply_zip(surfaces)
    if surface_format == SurfaceFormat.NPZ:
        return formats.write_npz(surfaces)
    return formats.write_vtkhdf(surfaces, fields, attributes)
