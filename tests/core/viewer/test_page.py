"""A view as one file."""

from __future__ import annotations

import base64
import gzip
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from viewed_surfaces import viewed

import modalmotion as mm
from modalmotion.cli import main
from modalmotion.codec import decode, encode
from modalmotion.errors import LimitError, MissingExtraError, ParameterError
from modalmotion.formats import write_npz
from modalmotion.signature.making import modal_signature
from modalmotion.tracking.result import SampledData
from modalmotion.viewer import page
from modalmotion.viewer.container import read_container
from modalmotion.viewer.page import (
    View,
    data_payload,
    decoder,
    script,
    source_hash,
    style,
    view_page,
)


class Parts(HTMLParser):
    """Elements of a page, with the text of scripts and styles."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None], str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs), ""))

    def handle_endtag(self, tag: str) -> None:
        self.elements.append((f"/{tag}", {}, ""))

    def handle_data(self, data: str) -> None:
        if self.elements:
            tag, attributes, text = self.elements[-1]
            self.elements[-1] = (tag, attributes, text + data)


def parts_of(text: str) -> list[tuple[str, dict[str, str | None], str]]:
    parser = Parts()
    parser.feed(text)
    return parser.elements


def test_a_page_holds_all_and_may_ask_for_nothing() -> None:
    sequence, signature = viewed("cup")
    text = view_page([View(signature, sequence, 'a <b> & "c"')])
    elements = parts_of(text)
    policy = next(a["content"] for tag, a, _ in elements if a.get("http-equiv"))
    assert policy is not None
    assert policy.startswith("default-src 'none'")
    assert "connect-src" not in policy
    scripts = [part for part in elements if part[0] == "script"]
    code = [
        body
        for _, attributes, body in scripts
        if not (attributes.get("type") or "").startswith("application")
    ]
    assert code == [script(), page._START]
    assert all(source_hash(text) in policy for text in code)
    assert source_hash(style()) in policy
    held = [body for _, attributes, body in scripts if "data-payload" in attributes]
    assert read_container(gzip.decompress(base64.b64decode(held[0])))[0]["title"] == 'a <b> & "c"'
    assert "a &lt;b&gt; &amp;" in text
    asked = [a["src"] or "" for _, a, _ in elements if "src" in a]
    assert [source.partition(",")[0] for source in asked] == ["data:image/png;base64"]
    assert not any("href" in a for _, a, _ in elements)


def test_two_views_hold_their_frames_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "_PIECE", 700)
    views = [View(signature, sequence) for sequence, signature in map(viewed, ("cup", "torus"))]
    numbers = re.findall(r'data-frames="(\d)"', view_page(views))
    assert numbers == ["0"] * 5 + ["1"] * 5


def test_a_page_that_no_browser_opens_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "MOST_BYTES", 1_000)
    sequence, signature = viewed("cup")
    with pytest.raises(LimitError, match="fewer frames"):
        view_page([View(signature, sequence)])


def test_the_bundle_is_small_and_its_licences_are_beside_it() -> None:
    import zlib

    folder = Path(page.__file__).parent / "bundle"
    assert len(script().encode()) <= 600_000
    assert len(zlib.compress(script().encode(), 6)) <= 155_000
    assert "MIT" in (folder / "LICENSES.txt").read_text()
    # Neither ends a script in the middle, nor names a host that it could ask.
    assert "</script" not in script().lower()
    hosts = set(re.findall(r"https?://([\w.-]+)", script()))
    assert hosts <= {"www.w3.org", "jcgt.org", "github.com"}


def test_the_command_writes_a_page_of_one_file_or_of_two(tmp_path: Path) -> None:
    first, second = tmp_path / "first.npz", tmp_path / "second.npz"
    first.write_bytes(write_npz(viewed("cup")[0]))
    second.write_bytes(write_npz(viewed("cylinder")[0]))
    out = tmp_path / "beat.html"
    run = CliRunner().invoke(
        main, ["view", str(first), "--with", str(second), "--modes", "4", "-o", str(out)]
    )
    assert run.exit_code == 0, run.output
    text = out.read_text()
    assert "<title>first.npz and second.npz · modalmotion</title>" in text
    assert text.count("data-payload=") == script().count("data-payload=") + 2


def test_a_page_of_a_stream_holds_it_and_its_decoder() -> None:
    sequence, signature = viewed("cup")
    stream = encode(sequence, rms=0.01).data
    decoded = decode(stream)
    of_stream = View(modal_signature(decoded), decoded, stream=stream)
    text = view_page([of_stream, View(signature, sequence)])
    held = {
        next(iter(set(attributes) - {"type"})): body
        for tag, attributes, body in parts_of(text)
        if attributes.get("type") == "application/octet-stream"
    }
    assert gzip.decompress(base64.b64decode(held["data-stream"])) == stream
    assert gzip.decompress(base64.b64decode(held["data-decoder"])) == decoder()
    assert 'data-frames="0"' not in text
    assert "'wasm-unsafe-eval'" in text.split("</head>")[0]
    assert "wasm-unsafe-eval" not in view_page([View(signature, sequence)]).split("</head>")[0]


def test_a_compressed_file_is_viewed_as_it_is(tmp_path: Path) -> None:
    sequence, _ = viewed("cup")
    for name, rms, is_held in (("coarse", 0.01, True), ("whole", 1e-12, False)):
        stream = tmp_path / f"{name}.mms"
        stream.write_bytes(encode(sequence, rms=rms).data)
        page = tmp_path / f"{name}.html"
        run = CliRunner().invoke(main, ["view", str(stream), "-o", str(page), "--no-classify"])
        assert run.exit_code == 0, run.output
        assert ('data-stream="0"' in page.read_text()) == is_held


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_widget_holds_what_the_page_reads() -> None:
    pytest.importorskip("anywidget")
    sequence, signature = viewed("cup")
    shown = mm.view(signature, sequence)
    assert read_container(shown.payload)[0]["sequence_id"] == sequence.id
    assert len(read_container(shown.frames[0])[1]["frames"]) == sequence.n_frames
    assert shown._esm == script()
    fitted = mm.view(sequence, parameters=mm.SignatureParameters(modes=4))
    assert read_container(fitted.payload)[1]["amplitudes"].shape[1] == 4


def test_a_signature_alone_has_no_surface() -> None:
    with pytest.raises(ParameterError, match=r"view\(signature, sequence\)"):
        mm.view(viewed("cup")[1])


def test_without_anywidget_the_command_that_installs_it_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    page._widget.cache_clear()
    monkeypatch.setitem(sys.modules, "anywidget", None)
    with pytest.raises(MissingExtraError, match="pip install anywidget"):
        mm.view(viewed("cup")[0])
    page._widget.cache_clear()


@pytest.mark.parametrize("far", [0.0, 1e7])
def test_points_keep_their_places_and_what_they_are(rng: np.random.Generator, far: float) -> None:
    points = far + rng.normal(0.0, 40.0, (6, 3))
    weights = np.array([0.0, 0.05, 0.5, 1.0, 1.0, 1.0])
    marks = np.arange(6) == 5
    data = SampledData(points, weights, marks, np.array([4, 0, 2]))
    header, arrays = read_container(data_payload(data))
    assert header["counts"] == [4, 0, 2]
    back = arrays["points"] + np.array(header["origin"])
    assert np.abs(back - points).max() < 2e-5
    assert arrays["weights"].tolist() == [0, 13, 128, 255, 255, 255]
    assert arrays["landmarks"].tolist() == [0, 0, 0, 0, 0, 1]


@pytest.mark.parametrize("size", [1e-200, 1e-12, 1e12, 1e60])
def test_extreme_lengths_are_sent_in_another_unit(rng: np.random.Generator, size: float) -> None:
    points = size * rng.normal(size=(9, 3))
    data = SampledData(points, np.ones(9), np.zeros(9, dtype=bool), np.array([9]))
    header, arrays = read_container(data_payload(data))
    back = arrays["points"].astype(np.float64) * header["length"] + np.array(header["origin"])
    assert np.abs(back - points).max() < 1e-6 * size


def test_no_points_are_no_error() -> None:
    nothing = np.zeros(0)
    data = SampledData(np.zeros((0, 3)), nothing, nothing.astype(bool), np.zeros(2, dtype=np.int64))
    header, arrays = read_container(data_payload(data))
    assert (header["origin"], arrays["points"].shape) == ([0.0, 0.0, 0.0], (0, 3))
