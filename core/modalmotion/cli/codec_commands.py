"""Commands of the codec: encode and decode."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from modalmotion.cli.files import read, sequence_argument
from modalmotion.formats import write_npz, write_raw, write_vtkhdf
from modalmotion.store import write_atomic

_WRITERS = {".npz": write_npz, ".vtkhdf": write_vtkhdf, ".raw": write_raw}


@click.command()
@sequence_argument
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Stream.")
@click.option("--rms", type=float, help="RMS distance of vertices that is not exceeded.")
@click.option("--max-error", type=float, help="Of every coordinate, never exceeded.")
@click.option("--bytes", "n_bytes", type=int, help="Size of the stream that is not exceeded.")
@click.option(
    "--effort",
    type=click.Choice(["fast", "balanced", "thorough"]),
    default="balanced",
    show_default=True,
    help="How many transforms are tried.",
)
def encode(
    source: Path,
    output: Path,
    rms: float | None,
    max_error: float | None,
    n_bytes: int | None,
    effort: str,
    **said: Any,
) -> None:
    """Compress the sequence in FILE at an error (in its unit) or a size that you choose."""
    from modalmotion.codec import encode as compress

    sequence = read(source, **said)
    with click.progressbar(length=100, label="encode", file=sys.stderr) as bar:
        found = compress(
            sequence,
            rms=rms,
            max_error=max_error,
            n_bytes=n_bytes,
            effort=effort,
            progress=lambda share: bar.update(round(100 * share) - bar.pos),
        )
    write_atomic(output, found.data)
    unit = sequence.unit or "length units"
    click.echo(
        f"{found.n_bytes} bytes, {found.bits_per_vertex_and_frame:.3f} bits a vertex and frame; "
        f"error {found.rms:.4g} {unit} RMS, {found.max_error:.4g} {unit} at most in a "
        f"coordinate, KG {found.kg_error:.3g} %; {found.transform}"
    )
    click.echo(f"written: {output}")


@click.command()
@click.argument("stream", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path),
    help="File to write: .npz, .vtkhdf or .raw (float32).",
)
@click.option("--first", type=int, help="First frame.")
@click.option("--stop", type=int, help="Frame after the last.")
def decode(stream: Path, output: Path, first: int | None, stop: int | None) -> None:
    """Decode a compressed STREAM, or some of its frames."""
    from modalmotion.codec import decode as expand
    from modalmotion.codec import inspect

    if output.suffix not in _WRITERS:
        raise click.BadParameter(
            f"{output.name} ends with none of {', '.join(_WRITERS)}.", param_hint="--output"
        )
    data = stream.read_bytes()
    frames = None
    if first is not None or stop is not None:
        n_frames = inspect(data).n_frames
        frames = range(first or 0, n_frames if stop is None else stop)
    sequence = expand(data, frames=frames)
    write_atomic(output, _WRITERS[output.suffix](sequence))
    click.echo(f"{sequence.n_frames} frames of {sequence.n_vertices} vertices: {output}")
