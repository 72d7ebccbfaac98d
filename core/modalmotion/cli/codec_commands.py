"""Commands of the codec: encode and decode."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.cli.options import command, json_option, output_option, tell
from modalmotion.formats import write_npz, write_raw, write_vtkhdf
from modalmotion.store import write_atomic

_WRITERS = {".npz": write_npz, ".vtkhdf": write_vtkhdf, ".raw": write_raw}


@command("encode beat.npz -o beat.mms --max-error 0.1")
@sequence_argument
@output_option("Stream to write.")
@click.option("--rms", type=float, help="Largest RMS distance of the vertices, in their unit.")
@click.option("--max-error", type=float, help="Largest error of any vertex, in its unit.")
@click.option("--bytes", "n_bytes", type=int, help="Largest size of the stream.")
@click.option(
    "--effort",
    type=click.Choice(["fast", "balanced"]),
    default="balanced",
    show_default=True,
    help="Number of transforms tried: fast takes a third of the time and more bits.",
)
@json_option
def encode(
    source: Path,
    output: Path,
    rms: float | None,
    max_error: float | None,
    n_bytes: int | None,
    effort: str,
    as_json: bool,
    **options: Any,
) -> None:
    """Compress the sequence in FILE at a given error (in its unit) or size.

    Without either, the largest error is 0.3 % of the diagonal of its bounding box.
    """
    from modalmotion.codec import encode as compress

    sequence = read(source, **options)
    with click.progressbar(length=100, label="encode", file=sys.stderr) as bar:
        stream = compress(
            sequence,
            rms=rms,
            max_error=max_error,
            n_bytes=n_bytes,
            effort=effort,
            progress=lambda share: bar.update(round(100 * share) - bar.pos),
        )
    write_atomic(output, stream.data)
    unit = sequence.unit or "length units"
    said = (
        f"{stream.n_bytes} bytes, {stream.bits_per_vertex_and_frame:.3f} bits per vertex and "
        f"frame; error {stream.rms:.4g} {unit} RMS, {stream.max_error:.4g} {unit} at most at a "
        f"vertex, KG {stream.kg_error:.3g} %; {stream.transform}"
    )
    found = {
        "n_bytes": stream.n_bytes,
        "bits_per_vertex_and_frame": stream.bits_per_vertex_and_frame,
        "rms": stream.rms,
        "max_error": stream.max_error,
        "kg_error_percent": stream.kg_error,
        "unit": sequence.unit,
        "transform": stream.transform,
    }
    tell(found, [said], output, as_json=as_json)


@command("decode beat.mms -o beat.npz")
@click.argument("stream", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@output_option("File to write: .npz, .vtkhdf or .raw (float32).", *_WRITERS)
@click.option("--first", type=int, help="First frame.")
@click.option("--stop", type=int, help="Frame after the last.")
@click.option("--first-vertex", type=int, help="First vertex.")
@click.option("--stop-vertex", type=int, help="Vertex after the last.")
@click.option(
    "--threads",
    "n_threads",
    type=click.IntRange(1, 256),
    default=1,
    show_default=True,
    help="Number of patches of a mesh that are solved in parallel.",
)
@json_option
def decode(
    stream: Path,
    output: Path,
    first: int | None,
    stop: int | None,
    first_vertex: int | None,
    stop_vertex: int | None,
    n_threads: int,
    as_json: bool,
) -> None:
    """Decode a compressed STREAM, or some of its frames and vertices.

    Selected vertices come with the triangles between them.
    """
    from modalmotion.codec import decode as expand
    from modalmotion.codec import inspect

    write = _WRITERS[output.suffix.lower()]
    data = stream.read_bytes()
    header = inspect(data)
    frames = _span(first, stop, header.n_frames)
    vertices = _span(first_vertex, stop_vertex, header.n_vertices)
    sequence = expand(data, frames=frames, vertices=vertices, n_threads=n_threads)
    write_atomic(output, write(sequence))
    found = {"n_frames": sequence.n_frames, "n_vertices": sequence.n_vertices}
    said = f"{sequence.n_frames} frames of {sequence.n_vertices} vertices"
    tell({**found, "unit": sequence.unit}, [said], output, as_json=as_json)


def _span(first: int | None, stop: int | None, n: int) -> range | None:
    """Make the range between two ends; None without either."""
    if first is None and stop is None:
        return None
    return range(first or 0, n if stop is None else stop)
