"""The module for other people's pages: the library's bits in Node and in Chromium."""

from __future__ import annotations

import json
import shutil
import subprocess
import tarfile
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import browser
from codec_sequences import jointed, lattice_sequence, small_mesh_of_tube
from project import ROOT

from modalmotion.codec import Effort, decode, encode
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence

# Gives the numbers as a browser or Node has them; the digest shows every bit.
SCRIPT = """
const digest = async (array) =>
  Array.from(new Uint8Array(await crypto.subtle.digest("SHA-256", array)))
    .map((byte) => byte.toString(16).padStart(2, "0")).join("");
const told = async (found) => ({
  positions: await digest(found.positions), faces: await digest(found.faces),
  times: found.times && Array.from(found.times),
  type: found.positions.constructor.name, unit: found.unit, frames: found.nFrames,
});
const refused = async (work) => {
  try { await work(); return null; } catch (error) { return `${error.name}: ${error.message}`; }
};
"""


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package as npm installs it, beside streams."""
    if shutil.which("npm") is None:
        pytest.skip("npm is absent")
    folder = tmp_path_factory.mktemp("module")
    source = folder / "source" / "web" / "decode"
    shutil.copytree(ROOT / "web" / "decode", source)
    bundle = folder / "source" / "core" / "modalmotion" / "viewer" / "bundle"
    bundle.mkdir(parents=True)
    shutil.copy(ROOT / "core" / "modalmotion" / "viewer" / "bundle" / "decode.wasm", bundle)
    shutil.copy(ROOT / "LICENSE", folder / "source")
    subprocess.run(["npm", "pack", "--silent"], cwd=source, check=True, capture_output=True)
    (archive,) = source.glob("*.tgz")
    with tarfile.open(archive) as opened:
        opened.extractall(folder / "unpacked", filter="data")
    return folder / "unpacked" / "package"


@pytest.fixture(scope="module")
def streams(packed: Path) -> dict[str, bytes]:
    rng = np.random.default_rng(7)
    made: dict[str, MeshSequence] = {
        "lattice": lattice_sequence(rng),
        "tube": small_mesh_of_tube(rng),
        "parts": jointed(rng, n_links=7, n_frames=30),
        "points": mesh_sequence(rng.normal(size=(9, 5, 3)).cumsum(axis=0), unit="cm"),
    }
    found = {
        f"{name}-{effort.value}": encode(sequence, rms=0.05, effort=effort).data
        for name, sequence in made.items()
        for effort in Effort
    }
    for name, data in found.items():
        (packed / f"{name}.mmsq").write_bytes(data)
    return found


def digests_of(data: bytes) -> dict[str, object]:
    from hashlib import sha256

    sequence = decode(data)
    is_double = sequence.vertices.dtype == np.float64
    return {
        "positions": sha256(sequence.vertices.tobytes()).hexdigest(),
        "faces": sha256(sequence.faces.astype("<u4").tobytes()).hexdigest(),
        "times": None if sequence.times is None else sequence.times.tolist(),
        "type": "Float64Array" if is_double else "Float32Array",
        "unit": sequence.unit,
        "frames": sequence.n_frames,
    }


def test_the_package_holds_what_it_needs(packed: Path) -> None:
    assert {path.name for path in packed.iterdir() if path.suffix != ".mmsq"} == {
        *("decode.js", "decode.d.ts", "decode.wasm", "LICENSE", "README.md", "package.json")
    }


def in_node(packed: Path, text: str) -> Any:
    if shutil.which("node") is None:
        pytest.skip("node is absent")
    program = packed / "told.mjs"
    program.write_text(
        'import { decode, decoder } from "./decode.js";\n'
        'import { readFile } from "node:fs/promises";\n'
        f"const own = (name) => readFile(new URL(name, import.meta.url));{SCRIPT}{text}"
    )
    run = subprocess.run(["node", program], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_node_decodes_the_same_bits(packed: Path, streams: dict[str, bytes]) -> None:
    text = f"""
    const all = {{}};
    for (const name of {json.dumps(sorted(streams))})
      all[name] = await told(await decode(await own(`${{name}}.mmsq`)));
    console.log(JSON.stringify(all));
    """
    assert in_node(packed, text) == {name: digests_of(data) for name, data in streams.items()}


def test_some_frames_and_what_is_refused(packed: Path, streams: dict[str, bytes]) -> None:
    text = """
    const bytes = await own("lattice-fast.mmsq");
    const some = await decode(bytes, { first: 2, stop: 4 });
    const mended = await decoder(await own("decode.wasm"));
    console.log(JSON.stringify([
      Array.from(some.positions), some.first, (await told(mended(bytes))).positions,
      await refused(() => decode(bytes.subarray(0, 90))),
      await refused(() => decode(bytes, { stop: 99 })),
      await refused(() => decode(bytes, { mostBytes: 99 })),
      await refused(() => decode(new TextEncoder().encode("nothing of the kind"))),
    ]));
    """
    positions, first, whole, *refused = in_node(packed, text)
    expected = decode(streams["lattice-fast"]).vertices
    assert np.array_equal(np.array(positions, np.float32), expected[2:4].ravel())
    assert first == 2
    assert whole == digests_of(streams["lattice-fast"])["positions"]
    for error, told in zip(
        refused, ("cut", "not in a stream of 9", "over 99", "not an enc"), strict=True
    ):
        assert told in error


@pytest.fixture
def address(packed: Path) -> Iterator[str]:
    handler = partial(SimpleHTTPRequestHandler, directory=str(packed))
    handler.log_message = lambda *_: None  # type: ignore[attr-defined]
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_chromium_decodes_the_same_bits(
    packed: Path, streams: dict[str, bytes], address: str
) -> None:
    (packed / "page.html").write_text("<!doctype html><title>A page</title>")
    text = f"""async () => {{
      const {{ decode }} = await import("{address}/decode.js");
      {SCRIPT}
      const all = {{}};
      for (const name of {json.dumps(sorted(streams))}) {{
        const bytes = await (await fetch(`{address}/${{name}}.mmsq`)).arrayBuffer();
        all[name] = await told(await decode(new Uint8Array(bytes)));
      }}
      return all;
    }}"""
    with browser() as chromium, chromium.open(f"{address}/page.html") as opened:
        found = opened.page.evaluate(text)
    assert found == {name: digests_of(data) for name, data in streams.items()}
