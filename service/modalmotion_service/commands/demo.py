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

from modalmotion.cli.outputs import OutputFolder
from modalmotion.client import Client, Info
from modalmotion.clinical import Fraction
from modalmotion.errors import InputError, ModalMotionError
from modalmotion.formats import read_npz, write_npz
from modalmotion.pictures.signature import signature_figure
from modalmotion.representation import numeral
from modalmotion.signature.making import ModalSignature
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
        name = "a simulated ventricle"
        body = write_npz(
            simulate_ventricle(acquisition=Acquisition(noise=0.6), rng=np.random.default_rng(1994))
        )
    else:
        name, body = str(file), file.read_bytes()
    output.mkdir(parents=True, exist_ok=True)
    started = time.perf_counter()
    with _service(output / "results") as (client, base):
        click.echo(f"           ready after {time.perf_counter() - started:.1f} s")
        click.echo(f"sequence   {name}, {len(body)} bytes")
        sequence = client.upload(body)
        name = file.name if file else "Sample heart (simulated)"
        client.request("PATCH", f"/v1/sequences/{sequence.id}", json={"name": name})
        click.echo(
            f"           {sequence.n_frames} frames of {sequence.n_vertices} vertices, "
            f"id {sequence.id[:12]}..."
        )
        made = client.request("POST", f"/v1/sequences/{sequence.id}/signatures").json
        file, here = made["file"], f"/v1/signatures/{made['key']}"
        image = client.request("GET", here, accept="application/x-hdf5").content
        readouts = _readouts(client, f"{here}/readouts")
        answer = client.classify(sequence.id)
        page = output / "beat.html"
        html = client.request("GET", f"{here}/view", accept="text/html")
        page.write_bytes(html.content)
        _print_answers(signature_from_hdf5(image), readouts, answer)
        click.echo(f"page       {page} (open it in a browser: the surface moves)")
        until = "Ctrl-C ends the service" if stays else "while it runs: make demo OPEN=1"
        click.echo(f"look at    {base}/view/{sequence.id} ({until})")
        if stays:
            # Where there is no browser, the address above is for one elsewhere.
            click.launch(f"{base}/view/{sequence.id}")
            _wait()
    signature = signature_from_hdf5(image)
    path = output / "results" / file
    stored = signature_from_hdf5(path)
    # Bytes differ: an answer carries the facts of its sequence, which its file does not.
    is_same = stored.amplitudes.tobytes() == signature.amplitudes.tobytes()
    click.echo(
        f"HDF5       {path} ({path.stat().st_size} bytes; the same amplitudes over HTTP: "
        f"{'yes' if is_same else 'NO'})"
    )
    picture = output / "systole.png"
    signature_figure(read_npz(body).sequence, signature).savefig(picture)
    click.echo(f"picture    {picture}")


def _print_answers(signature: ModalSignature, readouts: str, answer: Info) -> None:
    _print_signature(signature)
    click.echo(f"volume     {readouts}")
    _print_classification(answer)


def _wait() -> None:
    """Sleep until a person has seen enough."""
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            time.sleep(3600)


def _print_signature(signature: ModalSignature) -> None:
    frames, modes, directions = signature.amplitudes.shape
    unit = signature.unit or "length units"
    motion = float(np.sqrt(np.mean(np.square(signature.motion_rms))))
    farthest = int(np.argmax(signature.motion_rms))
    click.echo(
        f"signature  {signature.surface}, shape ({frames}, {modes}, {directions}): "
        f"{modes * directions} amplitudes a frame, {signature.compression:.0f}:1"
    )
    for title, frame in (("first frame", 0), ("systole", farthest)):
        click.echo(f"           {title} (frame {frame}), x y z in {unit}:")
        for label, row in zip(signature.modes.labels, signature.amplitudes[frame], strict=True):
            click.echo(
                f"             {label!s:>12} "
                + " ".join(f"{numeral(value, of=motion):>9}" for value in row)
            )
    click.echo(
        f"error      {numeral(signature.rms_error, of=motion)} {unit} RMS over all vertices and "
        f"frames, of {numeral(motion)} {unit} of motion; "
        f"max {numeral(signature.max_error, of=motion)} {unit}"
    )
    for note in signature.notes:
        click.echo(f"           note: {note}")


def _readouts(client: Client, path: str) -> str:
    """Ask for volume and ejection fraction; a surface that encloses nothing has none."""
    try:
        answer = client.request("GET", path).json
    except InputError as error:
        return f"none: {error.message}"
    volumes, unit = answer["from_signature"], answer["volume_unit"]
    large, small = (volumes[f"end_{name}_volume"]["value"] for name in ("diastolic", "systolic"))
    text = f"{numeral(large, 1)} to {numeral(small, 1)} {unit}"
    for name in Fraction:
        share, own = volumes[name.value], answer["of_mesh"][name.value]
        if share is not None and own is not None:
            text += (
                f", {name.words} {share['value']:.1f} % ({share['low']:.1f} to "
                f"{share['high']:.1f}; of the mesh itself {own['value']:.1f})"
            )
    return text


def _print_classification(answer: Info) -> None:
    if answer.label is None:
        click.echo(f"class      none: {answer.model} abstains")
    else:
        click.echo(
            f"class      {answer.label}, probability {answer.probability:.3f} "
            f"(model {answer.model})"
        )
    for note in answer.notes:
        click.echo(f"           note: {note}")


@contextmanager
def _service(data_dir: Path) -> Iterator[tuple[Client, str]]:
    """Run the service on a free loopback port until the block ends; gives its address too."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    log = data_dir.parent / "service.log"
    with log.open("wb") as sink:
        process = subprocess.Popen(  # noqa: S603 (our own program)
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
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _await_ready(process: subprocess.Popen[bytes], client: Client, log: Path) -> None:
    end = time.monotonic() + 60
    while not client.is_ready():
        if process.poll() is not None:
            raise click.ClickException(
                f"The service ended with status {process.returncode}:\n{log.read_text()[-2000:]}"
            )
        if time.monotonic() > end:
            raise click.ClickException(f"The service is not ready after 60 s; see {log}.")


if __name__ == "__main__":
    main()
