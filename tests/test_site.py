"""The site's own pages: what they show runs, and what they name is there."""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from browser import browser
from http_reference import http_reference
from play import play_page, sample_stream
from project import ROOT

import modalmotion as mm


def test_the_tutorial_runs() -> None:
    pytest.importorskip("matplotlib")
    text = (ROOT / "docs/start.md").read_text()
    namespace: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        # Of a surface that is small: what is shown is how.
        small = "simulate_ventricle(grid=(12, 24))"
        exec(block.replace("simulate_ventricle()", small), namespace)  # noqa: S102 (our own)


def test_the_reference_names_what_is_public() -> None:
    listed = re.findall(
        r"^   (\w+)$", (ROOT / "docs/reference/python.md").read_text(), re.MULTILINE
    )
    assert len(listed) > 30
    assert set(listed) <= set(dir(mm))


def test_each_page_is_in_the_index() -> None:
    index = (ROOT / "docs/index.md").read_text()
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"}
    assert pages <= set(re.findall(r"^([\w/]+)$", index, re.MULTILINE))


def test_there_is_one_version() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert re.fullmatch(r"\d+\.\d+\.\d+", version)
    for file, pattern in (
        ("CITATION.cff", r"^version: (.+)$"),
        ("docker-compose.yml", r"image: modalmotion:(.+)"),
        ("deploy/kubernetes.yaml", r"image: modalmotion:(.+)"),
        ("web/decode/package.json", r'"version": "(.+)"'),
    ):
        named = re.findall(pattern, (ROOT / file).read_text(), re.MULTILINE)
        assert set(named) == {version}, file


def test_every_call_of_the_interface_has_its_parameters_on_the_page() -> None:
    interface = json.loads((ROOT / "openapi" / "openapi.json").read_text())
    page = http_reference(interface)
    sections = dict(re.findall(r"^### `(.+)`\n((?:(?!^##).*\n)*)", page, re.MULTILINE))
    calls = {
        f"{method.upper()} {path}": call
        for path, methods in interface["paths"].items()
        for method, call in methods.items()
    }
    assert sections.keys() == calls.keys()
    for name, call in calls.items():
        assert call["summary"] in sections[name]
        for parameter in call.get("parameters", []):
            own = parameter.get("name", parameter.get("$ref", "").rpartition("/")[2])
            assert f"| `{own}` |" in sections[name], name
    body = sections["POST /v1/sequences/{sequence_id}/signatures"]
    assert "| `components` | body | `cartesian`" in body


def test_there_is_a_gallery_of_twelve_questions() -> None:
    pages = sorted((ROOT / "docs/gallery").glob("plot_*.py"))
    assert len(pages) == 12
    for page in pages:
        assert page.read_text().splitlines()[1].endswith("?")


@pytest.fixture(scope="module")
def play() -> str:
    """The page on which a heart can be moved."""
    return play_page(sample_stream())


def test_the_page_to_play_with_is_small(play: str) -> None:
    assert len(play.encode()) <= 400_000


def test_node_decodes_what_the_page_holds(play: str, tmp_path: Path) -> None:
    if shutil.which("node") is None:
        pytest.skip("node is absent")
    (tmp_path / "heart.html").write_text(play)
    (tmp_path / "read.mjs").write_text(
        f"""import {{ decoder }} from {json.dumps((ROOT / "web/decode/decode.js").as_uri())};
import {{ readFileSync }} from "node:fs";
import {{ gunzipSync }} from "node:zlib";
import {{ createHash }} from "node:crypto";
const held = (page, name) =>
  gunzipSync(Buffer.from(page.match(new RegExp(`${{name}}[^>]*>([^<]+)<`))[1], "base64"));
const inner = held(readFileSync("heart.html", "utf8"), 'id="packed"').toString();
const decode = await decoder(held(inner, "data-decoder"));
const {{ positions }} = decode(new Uint8Array(held(inner, 'data-stream="0"')));
console.log(createHash("sha256").update(positions).digest("hex"));
"""
    )
    done = subprocess.run(
        ["node", "read.mjs"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    decoded = mm.decode(sample_stream()).vertices
    assert done.stdout.strip() == hashlib.sha256(decoded.tobytes()).hexdigest()


def test_a_mode_moves_in_chromium_and_nothing_is_asked_for(play: str, tmp_path: Path) -> None:
    path = tmp_path / "heart.html"
    path.write_text(play)
    with browser() as chromium, chromium.open(path.as_uri()) as opened:
        opened.shown()
        contraction = opened.page.get_by_label("Share of radial contraction, (0, 1)", exact=True)
        before = opened.page.evaluate("Array.from(modalmotion.gains[0])")
        contraction.fill("0")
        after = opened.page.evaluate("Array.from(modalmotion.gains[0])")
        assert set(before) == {1}
        assert sorted(after)[:2] == [0, 1]
        # Amplitudes of the same frame, without this mode and with it.
        read = "modalmotion.read(0, 'superposed', 10, {}, 1).positions"
        still, moved = (opened.page.evaluate(read.format(gains)) for gains in (after, before))
        assert max(abs(a - b) for a, b in zip(still, moved, strict=True)) > 0.05
        assert opened.said == []
        assert opened.asked == [path.as_uri()]


def test_the_page_itself_forbids_every_request(play: str) -> None:
    (packed,) = re.findall(r'id="packed">([^<]+)<', play)
    inner = gzip.decompress(base64.b64decode(packed)).decode()
    assert "default-src 'none'" in re.findall(r'Policy" content="([^"]+)"', inner)[0]


@pytest.mark.every(4)
@pytest.mark.parametrize(
    "page", sorted((ROOT / "docs/gallery").glob("plot_*.py")), ids=lambda p: p.stem
)
def test_examples_of_the_gallery_run_and_draw(page: Path) -> None:
    pytest.importorskip("nibabel")
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    namespace: dict[str, object] = {}
    exec(page.read_text(), namespace)  # noqa: S102 (our own example)
    assert "figure" in namespace or pyplot.get_fignums()
    pyplot.close("all")
