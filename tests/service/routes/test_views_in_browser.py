"""A person's way through the pages of a service, in a real browser. Needs Chromium."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, Opened, browser
from ellipsoid_images import LANDMARKS, MIDDLE, volume
from running import RunningService

from modalmotion.formats.volumes.one_file import write_nifti
from modalmotion.images import ImageSequence
from modalmotion.tracking.landmarks import read_landmark_file
from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as started:
        yield started


def test_from_a_dropped_file_to_a_page_of_one_file(
    chromium: Browser, tmp_path: Path, beat: bytes
) -> None:
    pytest.importorskip("nibabel")
    (tmp_path / "beat.npz").write_bytes(beat)
    # Under a path, as a proxy has it; the other tests are without one.
    settings = {"REQUIRE_KEYS": "true", "WORKERS": "1", "WAIT_SECONDS": "60"}
    service = RunningService(tmp_path / "results", {**settings, "PATH_PREFIX": "/motion"}).start()
    base = f"{service.base}/motion"
    try:
        with KeyRing(service.data_dir) as ring:
            token = ring.create("alice", frozenset({Scope.READ, Scope.WRITE}))[1]
        with chromium.open(f"{base}/") as opened:
            page = opened.page
            # The key is typed in, and kept in no address and no storage.
            page.locator("dialog input").fill(token)
            page.keyboard.press("Enter")
            page.set_input_files("#file", tmp_path / "beat.npz")
            opened.shown()
            assert page.url.startswith(f"{base}/view/")
            assert token not in page.url
            kept = "JSON.stringify([localStorage, sessionStorage, document.cookie])"
            assert page.evaluate(kept) == '[{},{},""]'
            # The file's name is kept, in a change and in no address.
            assert page.locator("h1").text_content() == "beat.npz"
            page.focus(".modes input")
            page.keyboard.press("Home")
            opened.wait("location.search.includes('gains=0')")
            assert "%" in page.locator(".readouts .big").text_content()
            page.get_by_role("button", name="Classify").click()
            opened.wait("document.querySelector('.class .sentence') !== null")
            for button, name in (("Table (CSV)", "table.csv"), ("One-file page", "beat.html")):
                with page.expect_download() as started:
                    page.get_by_role("button", name=button).click()
                started.value.save_as(tmp_path / name)
            assert [url for url in opened.asked if not url.startswith(f"{base}/")] == [
                url for url in opened.asked if url.startswith("blob:")
            ]
            # Only the answer that asked for the key was refused.
            refused = [text for text in opened.said if "401" not in text]
            assert refused == []
            # The list on the first page leads here too.
            page.go_back()
            opened.wait("document.querySelector('.model-class')?.title.length > 3")
            heads = page.locator("thead th").all_text_contents()
            assert heads[2:4] == ["Class (model)", "Stated label"]
            page.locator("table a").click()
            opened.wait("location.pathname.startsWith('/motion/view/')")
            address = page.url
        with chromium.open(address) as opened:
            opened.page.locator("dialog input").fill(token)
            opened.page.keyboard.press("Enter")
            opened.shown()
        with chromium.open(f"{base}/") as opened:
            opened.page.locator("dialog input").fill(token)
            opened.page.keyboard.press("Enter")
            from_images(opened, tmp_path)
    finally:
        service.stop()
    assert (tmp_path / "table.csv").read_text().startswith("frame,time_s,volume_ml")
    # The service is gone, and so is the network.
    with chromium.open((tmp_path / "beat.html").as_uri(), offline=True) as opened:
        opened.shown()
        assert opened.said == []
        assert opened.page.locator(".window").count() == 2
        assert opened.page.locator("h1").text_content() == "beat.npz"


def from_images(opened: Opened, folder: Path) -> None:
    """Drop images, click on both landmarks, save them, and look at what was tracked."""
    page, shape = opened.page, (27, 27, 35)
    affine = np.column_stack([3.0 * np.eye(3), MIDDLE - 1.5 * (np.array(shape) - 1)])
    frames = [volume(radius, affine=affine, shape=shape) for radius in (22.0, 18.0)]
    (folder / "beat.nii").write_bytes(
        gzip.decompress(write_nifti(ImageSequence(tuple(frames), np.array([0.0, 0.4]))))
    )
    page.set_input_files("#file", folder / "beat.nii")
    opened.wait("window.modalmotion?.views?.length === 3")
    assert page.url.rpartition("/")[0].endswith("/images")
    assert page.get_by_role("heading", name="It is a segmentation").is_hidden()
    assert page.locator(".pane strong").all_text_contents() == ["Axial", "Coronal", "Sagittal"]
    for name, place in LANDMARKS.items():
        assert page.locator(f"#landmark-{name}").is_checked()
        # To the slice that holds it, then onto it.
        point = f"[{', '.join(map(str, place))}]"
        page.evaluate(f"window.modalmotion.views[1].goTo({point})")
        x, y = page.evaluate(
            "(() => { const { slice, canvas } = window.modalmotion.views[1];"
            f"const {{ i, j }} = slice.under({point}); const box = canvas.getBoundingClientRect();"
            "return [box.left + (i + 0.5) / slice.counts[0] * box.width,"
            "box.top + (j + 0.5) / slice.counts[1] * box.height]; })()"
        )
        page.mouse.click(x, y)
        # It shows in every view, each in the slice that it lies in.
        assert page.locator(f".marks .{name}:not(.off)").count() == 3
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save landmarks").click()
    saved.value.save_as(folder / "landmarks.json")
    written = json.loads((folder / "landmarks.json").read_text())
    assert (written["coordinates"], written["unit"]) == ("LPS", "mm")
    # `--landmarks` takes the same file.
    marks = read_landmark_file((folder / "landmarks.json").read_bytes()).for_points("LPS", "mm")
    for name, place in LANDMARKS.items():
        assert np.abs(np.ravel(marks[name])[:3] - place).max() < 2.0, name
        # A voxel is 3 mm wide, and the slice's middle is clicked on.
        assert np.abs(np.array(written["landmarks"][name]) - place).max() < 2.0, name
    # By keyboard too: the apex is taken away, and placed again where the cross is.
    page.get_by_role("button", name="Take the apex away").click()
    assert page.get_by_role("button", name="Track the surface").is_disabled()
    page.locator("#landmark-apex").check()
    page.locator(".pane canvas").first.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Enter")
    assert page.locator(".marks .apex").count() > 0
    page.set_input_files("#landmark-file", folder / "landmarks.json")
    opened.wait(f"window.modalmotion.asJson().apex[0] === {written['landmarks']['apex'][0]}")
    page.locator("#keep").check()
    page.get_by_role("button", name="Track the surface").click()
    opened.shown()
    assert "/view/" in page.url
    opened.wait("document.querySelector('.track .figures') !== null")
    assert "mm" in page.locator(".track .figures td").first.text_content()
    assert "%" in page.locator(".readouts .big").text_content()
    strain = page.locator(".readouts tbody tr", has=page.get_by_text("GLS", exact=True))
    assert strain.locator("td").first.text_content().endswith("%")
    page.get_by_role("button", name="Estimated error").click()
    opened.wait("document.querySelector('dialog.picture[open] canvas')?.width > 200")
    page.keyboard.press("Escape")
    # Edges lie over the surface, and the surface crosses every slice of the kept images.
    opened.wait("modalmotion.clouds[0]?.drawn.length === 4")
    assert page.get_by_label("Show the data").is_checked()
    page.get_by_role("button", name="Contours in the slices").click()
    opened.wait("window.modalmotion?.views?.length === 3")
    line = "[...document.querySelectorAll('.contours path')].map(p => p.getAttribute('d').length)"
    assert min(page.evaluate(line)) > 200
    # Every place of a line is on the surface: its vertices are 3 mm apart, and edges straight.
    seen = "modalmotion.views.flatMap(v => v.slice.contours(v.surface).map(s => v.slice.at(...s)))"
    surface = page.evaluate("Array.from(modalmotion.views[0].surface.vertices)")
    places, vertices = np.array(page.evaluate(seen)), np.array(surface).reshape(-1, 3)
    away = np.linalg.norm(places[:, None] - vertices, axis=2).min(axis=1)
    assert len(places) > 100
    assert away.max() < 3.0
    page.get_by_role("button", name="Back to the moving surface").click()
    opened.shown()
    assert [text for text in opened.said if "401" not in text] == []
