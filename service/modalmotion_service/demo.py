"""The main job from end to end: start the service, send a sequence, print what comes back."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np

from modalmotion.figures import systole_figure
from modalmotion.formats import read_npz, write_npz
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
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the results and the picture.",
)
def main(file: Path | None, output: Path) -> None:
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
    with _service(output / "results") as base:
        click.echo(f"service    {base} (documentation at {base}/docs)")
        click.echo(f"           ready after {time.perf_counter() - started:.1f} s")
        click.echo(f"sequence   {name}, {len(body)} bytes")
        status, sequence = _json("POST", f"{base}/v1/sequences", body)
        known = "new" if status == 201 else "known already"
        click.echo(
            f"           {status} ({known}): {sequence['n_frames']} frames of "
            f"{sequence['n_vertices']} vertices, id {sequence['id'][:12]}..."
        )
        here = f"{base}/v1/sequences/{sequence['id']}"
        _, signature = _json("GET", f"{here}/signature")
        readouts = _readouts(f"{here}/readouts")
        _, answer = _json("POST", f"{here}/classifications")
        image = _request("GET", f"{here}/signature", accept="application/x-hdf5")[1]
    _print_signature(signature)
    click.echo(f"volume     {readouts}")
    _print_classification(answer)
    path = output / "results" / signature["file"]
    click.echo(
        f"HDF5       {path} ({len(image)} bytes, the same over HTTP: "
        f"{'yes' if path.read_bytes() == image else 'NO'})"
    )
    picture = output / "systole.png"
    systole_figure(read_npz(body).sequence, signature_from_hdf5(image)).savefig(picture)
    click.echo(f"picture    {picture}")


def _print_signature(signature: dict[str, Any]) -> None:
    frames, modes, directions = signature["shape"]
    unit = signature["unit"] or "length units"
    amplitudes = np.array(signature["amplitudes"])
    farthest = int(np.argmax(signature["motion_rms"]))
    click.echo(
        f"signature  {signature['topology']}, shape ({frames}, {modes}, {directions}): "
        f"{modes * directions} amplitudes a frame, {signature['compression']:.0f}:1"
    )
    for title, frame in (("first frame", 0), ("systole", farthest)):
        click.echo(f"           {title} (frame {frame}), x y z in {unit}:")
        for label, row in zip(signature["modes"], amplitudes[frame], strict=True):
            name = f"({', '.join(map(str, label['wavenumbers']))}, {label['part']})"
            click.echo(f"             {name:>12} " + " ".join(f"{value:8.3f}" for value in row))
    click.echo(
        f"error      {signature['rms_error']:.3f} {unit} RMS over all frames, of "
        f"{float(np.sqrt(np.mean(np.square(signature['motion_rms'])))):.3f} {unit} of motion; "
        f"max {signature['max_error']:.3f} {unit}"
    )
    for note in signature["notes"]:
        click.echo(f"           note: {note}")


def _readouts(url: str) -> str:
    """Ask for volume and ejection fraction; a surface that encloses nothing has none."""
    try:
        _, answer = _json("GET", url)
    except click.ClickException as error:
        return f"none: {error.message}"
    found, unit = answer["from_signature"], answer["volume_unit"]
    large, small = (found[f"end_{name}_volume"]["value"] for name in ("diastolic", "systolic"))
    ejected = found["ejection_fraction"]
    return (
        f"{large:.1f} to {small:.1f} {unit}, ejection fraction {ejected['value']:.1f} % "
        f"({ejected['low']:.1f} to {ejected['high']:.1f}; of the mesh itself "
        f"{answer['of_mesh']['ejection_fraction']['value']:.1f})"
    )


def _print_classification(answer: dict[str, Any]) -> None:
    if answer["label"] is None:
        click.echo(f"class      none: {answer['model']} abstains")
    else:
        click.echo(
            f"class      {answer['label']}, probability {answer['probability']:.3f} "
            f"(model {answer['model']})"
        )
    for note in answer["notes"]:
        click.echo(f"           note: {note}")


@contextmanager
def _service(data_dir: Path) -> Iterator[str]:
    """Run the service on a free loopback port until the block ends."""
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
    try:
        base = f"http://127.0.0.1:{port}"
        _await_ready(process, base, log)
        yield base
    finally:
        process.terminate()
        try:
            process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _await_ready(process: subprocess.Popen[bytes], base: str, log: Path) -> None:
    for _ in range(600):
        if process.poll() is not None:
            raise click.ClickException(
                f"The service ended with status {process.returncode}:\n{log.read_text()[-2000:]}"
            )
        try:
            _request("GET", f"{base}/health/ready")
        except urllib.error.URLError:
            time.sleep(0.1)
        else:
            return
    raise click.ClickException(f"The service is not ready after 60 s; see {log}.")


def _json(method: str, url: str, body: bytes | None = None) -> tuple[int, dict[str, Any]]:
    status, answer = _request(method, url, body)
    return status, json.loads(answer)


def _request(
    method: str, url: str, body: bytes | None = None, accept: str = "application/json"
) -> tuple[int, bytes]:
    headers = {"Accept": accept}
    if body is not None:
        headers["Content-Type"] = "application/octet-stream"
    request = urllib.request.Request(url, data=body, method=method, headers=headers)  # noqa: S310 (always our own loopback address)
    # No proxy: what the environment names is for the world outside, not for loopback.
    opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with opener.open(request, timeout=120) as response:
            return response.status, response.read()
    except urllib.error.HTTPError as error:
        problem = json.loads(error.read())
        raise click.ClickException(
            f"{method} {url} answered {error.code}: {problem['detail']} {problem.get('remedy', '')}"
        ) from error


if __name__ == "__main__":
    main()
