"""The main job from end to end: start the service, send a sequence, print what comes back."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
import numpy as np

from modalmotion.cli.shared import OutputFolder
from modalmotion.client import Client
from modalmotion.errors import InputError, ModalMotionError
from modalmotion.formats import read_npz, write_npz
from modalmotion.pictures.signature import signature_figure
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.store import signature_from_hdf5


@click.command()
@click.argument(
    "file", required=False, type=click.Path(exists=True, dir_okay=False, path_type=Path)
)
@click.option(
    "--output",
    default="demo-output",
    show_default=True,
    type=OutputFolder(),
    help="Folder for the results and the picture.",
)
@click.option("--open", "stays", is_flag=True, help="Leave the service running, to look at it.")
def main(file: Path | None, output: Path, stays: bool) -> None:
    """Send FILE (.npz), or a simulated ventricle, through a service of its own."""
    if file is None:
        name = "Sample heart (simulated)"
        body = write_npz(
            simulate_ventricle(acquisition=Acquisition(noise=0.6), rng=np.random.default_rng(1994))
        )
    else:
        name, body = file.name, file.read_bytes()
    output.mkdir(parents=True, exist_ok=True)
    with _service(output / "results") as (client, base):
        sequence = client.upload(body)
        client.update(sequence.id, name=name)
        click.echo(
            f"sequence   {name}: {sequence.n_frames} frames of {sequence.n_vertices} vertices, "
            f"id {sequence.id[:12]}..."
        )
        signature = client.signature(sequence.id, modes=7)
        kept = client.request("GET", f"/v1/sequences/{sequence.id}/signature").json["file"]
        unit = signature.unit or "length units"
        click.echo(
            f"signature  {signature.surface}, {signature.compression:.0f}:1, RMS error "
            f"{signature.rms_error:.3g} {unit} of {np.sqrt(np.mean(signature.motion_rms**2)):.3g}"
        )
        click.echo(f"volume     {_volumes(client, sequence.id)}")
        answer = client.classify(sequence.id)
        click.echo(f"class      {answer.label or 'none'} (probability {answer.probability:.3f})")
        for note in [*signature.notes, *answer.notes]:
            click.echo(f"           note: {note}")
        page = output / "beat.html"
        client.save("view", page, sequence.id)
        click.echo(f"page       {page} (open it in a browser: the surface moves)")
        until = "Ctrl-C ends the service" if stays else "while it runs: make demo OPEN=1"
        click.echo(f"look at    {base}/view/{sequence.id} ({until})")
        if stays:
            # Where there is no browser, the address above is for one elsewhere.
            click.launch(f"{base}/view/{sequence.id}")
            with contextlib.suppress(KeyboardInterrupt):
                while True:
                    time.sleep(3600)
    path = output / "results" / kept
    # Bytes differ: an answer has the facts of its sequence, which its file does not.
    is_same = np.array_equal(signature_from_hdf5(path).amplitudes, signature.amplitudes)
    click.echo(f"HDF5       {path} (the same amplitudes over HTTP: {'yes' if is_same else 'NO'})")
    picture = output / "systole.png"
    signature_figure(read_npz(body).sequence, signature).savefig(picture)
    click.echo(f"picture    {picture}")


def _volumes(client: Client, sequence_id: str) -> str:
    """Ask for volumes and their change; a surface that encloses nothing has none."""
    try:
        answer = client.readouts(sequence_id)
    except InputError as error:
        return f"none: {error.message}"
    found = answer["from_signature"]
    large, small = (found[f"end_{name}_volume"]["value"] for name in ("diastolic", "systolic"))
    share = found["ejection_fraction"] or found["volume_change"]
    change = f", {share['value']:.1f} % less" if share else ""
    return f"{large:.1f} to {small:.1f} {answer['volume_unit']}{change}"


@contextmanager
def _service(data_dir: Path) -> Iterator[tuple[Client, str]]:
    """Run the service on a free loopback port until the block ends; gives its address too."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    log = data_dir.parent / "service.log"
    with log.open("wb") as sink:
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "modalmotion", "serve"),
                *("--port", str(port), "--data-dir", str(data_dir)),
            ],
            stdout=sink,
            stderr=subprocess.STDOUT,
        )
    base = f"http://127.0.0.1:{port}"
    try:
        click.echo(f"service    {base} (documentation at {base}/docs)")
        with Client(base) as client:
            _await_ready(process, client, log)
            yield client, base
    except ModalMotionError as error:
        raise click.ClickException(str(error)) from error
    finally:
        process.terminate()
        process.wait()


def _await_ready(process: subprocess.Popen[bytes], client: Client, log: Path) -> None:
    end = time.monotonic() + 60
    while not client.is_ready():
        if process.poll() is not None or time.monotonic() > end:
            raise click.ClickException(f"The service did not start:\n{log.read_text()[-2000:]}")


if __name__ == "__main__":
    main()
