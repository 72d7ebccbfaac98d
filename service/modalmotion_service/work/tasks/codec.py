"""Sequences encoded and decoded."""

from __future__ import annotations

from pathlib import Path

from modalmotion.codec import decode, encode
from modalmotion.formats import ReadLimits, write_npz, write_raw, write_vtkhdf
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.store import sequence_from_hdf5
from modalmotion_service.http.negotiation import NPZ, RAW, VTKHDF
from modalmotion_service.schemas.requests import EncodingTarget
from modalmotion_service.schemas.results import EncodedAnswer
from modalmotion_service.work.task_progress import ProgressFile
from modalmotion_service.work.tasks.files import write_whole
from modalmotion_service.work.upload import Upload


def encode_upload(
    upload: Upload, target: EncodingTarget, output: Path, progress: Path
) -> EncodedAnswer:
    """Read an upload and write it as a compressed stream; `progress` is a `ProgressFile`."""
    return _encoded(upload.read().sequence, target, output, progress)


def encode_kept(
    sequence: Path, target: EncodingTarget, output: Path, progress: Path
) -> EncodedAnswer:
    """Write a kept sequence as a compressed stream; `progress` is a `ProgressFile`."""
    return _encoded(sequence_from_hdf5(sequence), target, output, progress)


def decode_upload(
    upload: Path,
    limits: ReadLimits,
    frames: range | None,
    vertices: range | None,
    media_type: str,
    output: Path,
) -> None:
    """Decode a compressed stream and write its sequence: npz, VTKHDF or raw float32."""
    sequence = decode(upload.read_bytes(), frames=frames, vertices=vertices, limits=limits)
    write = {NPZ: write_npz, VTKHDF: write_vtkhdf, RAW: write_raw}[media_type]
    write_whole(output, write(sequence))


def _encoded(
    sequence: MeshSequence, target: EncodingTarget, output: Path, progress: Path
) -> EncodedAnswer:
    found = encode(
        sequence,
        rms=target.rms,
        max_error=target.max_error,
        n_bytes=target.bytes,
        effort=target.effort,
        progress=ProgressFile(progress).write,
    )
    write_whole(output, found.data)
    return EncodedAnswer.of(found)
