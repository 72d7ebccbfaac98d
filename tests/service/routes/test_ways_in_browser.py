"""What a person does on the pages without a command line, in a real browser. Needs Chromium."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser import Browser, Opened, browser
from dicom_samples import study_instance
from ellipsoid_images import AXES, CUT, MIDDLE, Look, volume
from project import ROOT
from running import RunningService

from modalmotion.formats.volumes.one_file import write_nifti
from modalmotion.images import ImageSequence, Volume
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import Acquisition, simulate_ventricle

AXE = ROOT / "viewer" / "node_modules" / "axe-core" / "axe.min.js"
SHAPE = (27, 27, 35)
AFFINE = np.column_stack([3.0 * np.eye(3), MIDDLE - 1.5 * (np.array(SHAPE) - 1)])


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Address of a service that asks for no key."""
    folder = tmp_path_factory.mktemp("ways") / "results"
    service = RunningService(folder, {"WORKERS": "1", "WAIT_SECONDS": "60"}).start()
    try:
        yield service.base
    finally:
        service.stop()


def named(opened: Opened, name: str) -> None:
    """State a name, and wait for it."""
    opened.page.locator(".about summary").click()
    opened.page.fill("#about-name", name)
    save(opened, f"document.querySelector('h1')?.textContent === '{name}'")


def save(opened: Opened, condition: str) -> None:
    opened.page.get_by_role("button", name="Save", exact=True).click()
    opened.wait(condition)
    opened.shown()


def stated(opened: Opened, name: str) -> str:
    """Value of a read-out, with its unit."""
    row = opened.page.locator(".readouts tbody tr", has=opened.page.get_by_text(name, exact=True))
    return str(row.locator("td").first.text_content())


def pdf_of(opened: Opened, folder: Path) -> str:
    """Take the report away, and give its text as far as it is plain."""
    with opened.page.expect_download() as started:
        opened.page.get_by_role("button", name="Report (PDF)").click()
    started.value.save_as(folder / "report.pdf")
    assert (folder / "report.pdf").read_bytes().startswith(b"%PDF")
    return str(started.value.suggested_filename)


def serious(opened: Opened) -> list[tuple[str, list[str]]]:
    if not AXE.is_file():
        pytest.skip("axe-core is absent: npm ci in viewer/ installs it")
    opened.page.evaluate(AXE.read_text())
    return [
        (one["id"], [node["html"][:120] for node in one["nodes"]])
        for one in opened.page.evaluate("axe.run()")["violations"]
        if one["impact"] in ("serious", "critical")
    ]


def test_a_newcomer_reads_a_sample_heart_places_its_wall_and_takes_a_report(
    chromium: Browser, base: str, tmp_path: Path
) -> None:
    with chromium.open(base, viewport={"width": 1280, "height": 900}) as opened:
        page = opened.page
        page.get_by_role("button", name="Sample heart").click()
        opened.shown()
        assert page.locator("h1").text_content() == "Sample heart (simulated)"
        assert page.locator(".segment").count() == 4
        page.get_by_role("button", name="Place the anterior wall").first.click()
        box = page.locator(".window").first.bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 0.5 * box["height"])
        assert page.locator(".place-mark.anterior").count() == 2
        # By keyboard: what is under the cross.
        page.locator("#about-apex").click()
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("Enter")
        assert page.locator(".place-mark.apex").count() == 2
        page.get_by_role("button", name="Take the apex away").click()
        page.select_option("#about-coordinates", "LPS")
        save(opened, "document.querySelectorAll('.segment').length === 17")
        segments = page.locator(".chart", has=page.get_by_role("heading", name="Segments"))
        assert "at end systole" in segments.locator(".note").first.text_content()
        assert pdf_of(opened, tmp_path) == "Sample-heart-simulated-report.pdf"
        # The structured report needs LPS mm, which is stated now.
        (tmp_path / "instance.dcm").write_bytes(study_instance())
        with page.expect_download() as started:
            with page.expect_file_chooser() as chooser:
                page.get_by_role("button", name="DICOM SR").click()
            chooser.value.set_files(tmp_path / "instance.dcm")
        started.value.save_as(tmp_path / "objects.zip")
        with zipfile.ZipFile(tmp_path / "objects.zip") as objects:
            assert "report.dcm" in objects.namelist()
        with page.expect_download() as started:
            page.get_by_role("button", name="FHIR").click()
        started.value.save_as(tmp_path / "fhir.json")
        assert '"Bundle"' in (tmp_path / "fhir.json").read_text()
        assert opened.said == []


def test_a_class_that_a_job_makes_is_read_as_one_answer(
    chromium: Browser, base: str, tmp_path: Path
) -> None:
    (tmp_path / "beat.zip").write_bytes(zip_of_stl(ventricle(8)))
    with chromium.open(base, viewport={"width": 1280, "height": 900}) as opened:
        page = opened.page
        asked: list[str] = []

        def as_a_job(route: Any) -> None:
            preferred = {} if "POST" in asked else {"prefer": "respond-async"}
            asked.append(route.request.method)
            route.continue_(headers={**route.request.headers, **preferred})

        page.route("**/classifications", as_a_job)
        page.set_input_files("#file", tmp_path / "beat.zip")
        opened.shown()
        page.get_by_role("button", name="Classify").click()
        opened.wait("document.querySelector('.card.class .sentence')")
        # For the job, whose result is the answer.
        assert asked.count("POST") == 1
        # One answer of a model, and not the list of all.
        assert page.locator(".card.class .sentence strong").text_content()
        assert opened.said == []


def test_a_zip_of_stl_without_unit_gets_one_and_reads_in_millilitres(
    chromium: Browser, base: str, tmp_path: Path
) -> None:
    beat = ventricle(6)
    (tmp_path / "beat.zip").write_bytes(zip_of_stl(beat))
    with chromium.open(base, viewport={"width": 1280, "height": 900}) as opened:
        page = opened.page
        page.set_input_files("#file", tmp_path / "beat.zip")
        opened.shown()
        address = page.url
        assert "(unit unknown)" in page.locator(".facts").text_content()
        assert stated(opened, "EDV").endswith("cubed length units")
        # A note leads to the field that it asks for.
        page.get_by_role("button", name="State the seconds per frame").first.click()
        assert page.evaluate("document.activeElement.id") == "about-seconds"
        page.select_option("#about-unit", "mm")
        page.select_option("#about-cavity", "lv")
        save(opened, "document.querySelector('.facts')?.textContent.includes('lengths in mm')")
        assert stated(opened, "EDV").endswith(" ml")
        assert page.url.split("?")[0] != address.split("?")[0]
        assert page.locator("h1").text_content() == "beat.zip"
        assert opened.said == []


def test_a_mask_without_times_gets_seconds_and_rates(
    chromium: Browser, base: str, tmp_path: Path
) -> None:
    masks = [mask(radius) for radius in (22.0, 19.0, 17.0, 20.0)]
    (tmp_path / "mask.nii.gz").write_bytes(write_nifti(ImageSequence(tuple(masks), None)))
    with chromium.open(base, viewport={"width": 1280, "height": 900}) as opened:
        page = opened.page
        page.set_input_files("#file", tmp_path / "mask.nii.gz")
        opened.wait("window.modalmotion?.views?.length === 3")
        assert page.get_by_role("heading", name="It is a segmentation").is_visible()
        # Proposed, and so it can be tracked at once.
        assert page.get_by_role("button", name="Track the surface").is_enabled()
        assert page.locator(".doubt").is_hidden()
        # What is placed far outside is doubted.
        page.locator("#landmark-apex").check()
        page.locator(".slice canvas").first.click(position={"x": 4, "y": 4})
        assert "The apex lies more than 2 mm outside" in page.locator(".doubt").text_content()
        page.reload()
        opened.wait("window.modalmotion?.views?.length === 3")
        assert page.locator("#seconds").input_value() == ""
        page.fill("#seconds", "0.2")
        page.get_by_role("button", name="Track the surface").click()
        opened.shown()
        assert page.locator("h1").text_content() == "mask.nii.gz"
        volumes = page.locator(".chart", has=page.get_by_role("heading", name="Volume"))
        assert "Peak ejection" in volumes.text_content()
        assert "ml/s" in volumes.text_content()
        # Other seconds make another recording, with its track.
        page.locator(".about summary").click()
        page.fill("#about-seconds", "0.1")
        page.fill("#about-rate", "")
        save(opened, "Math.abs(window.modalmotion?.motions?.[0].times?.[1] - 0.1) < 1e-9")
        opened.wait("document.querySelector('.track .figures') !== null")
        assert "RMS distance to the data" in page.locator(".card.track").text_content()
        assert opened.said == []


def test_two_hearts_are_compared_and_one_is_deleted(
    chromium: Browser, base: str, tmp_path: Path
) -> None:
    for number, n_frames in enumerate((7, 8)):
        beat = ventricle(n_frames)
        (tmp_path / f"heart-{number}.zip").write_bytes(zip_of_stl(beat))
    with chromium.open(base, viewport={"width": 1280, "height": 900}) as opened:
        page = opened.page
        for number in range(2):
            page.goto(base)
            page.set_input_files("#file", tmp_path / f"heart-{number}.zip")
            opened.shown()
        picker = page.get_by_label("Compare with")
        opened.wait("document.querySelector('select[aria-label=\"Compare with\"]').length > 1")
        name = picker.locator("option", has_text="heart-0.zip").text_content()
        picker.select_option(label=name)
        opened.wait("window.modalmotion?.motions?.length === 2")
        opened.shown()
        differences = page.get_by_role("region", name="Differences")
        titles = differences.locator("h3").all_text_contents()
        assert titles[:3] == ["Volume", "GLS", "GCS"]
        assert "difference" in differences.locator(".legend").first.text_content()
        # The same colour for both, another dash.
        first = differences.locator(".chart").first.locator("path.curve.first")
        assert len({first.nth(k).evaluate("e => getComputedStyle(e).stroke") for k in (0, 1)}) == 1
        assert first.nth(0).get_attribute("stroke-dasharray") is None
        assert first.nth(1).get_attribute("stroke-dasharray")
        assert serious(opened) == []
        page.get_by_role("button", name="Delete").click()
        page.get_by_role("button", name="Keep it").click()
        assert "/view/" in page.url
        page.get_by_role("button", name="Delete").first.click()
        page.locator("dialog .delete").click()
        opened.wait("document.querySelector('.home .list table') !== null")
        listed = page.locator("tbody th").all_text_contents()
        assert any("heart-0.zip" in one for one in listed)
        assert not any("heart-1.zip" in one for one in listed)
        assert serious(opened) == []
        assert opened.said == []


def ventricle(n_frames: int) -> MeshSequence:
    """Simulate one with scattered vertices, closed at its apex."""
    acquisition = Acquisition(n_frames=n_frames)
    return simulate_ventricle(
        n_vertices=400, acquisition=acquisition, rng=np.random.default_rng(n_frames)
    )


def mask(radius: float) -> Volume:
    """Label the cavity 1 and its wall 2, as far as the cut at the base."""
    shown = volume(radius, Look(100.0, 50.0, 0.0, noise=0.0), affine=AFFINE, shape=SHAPE)
    index = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1)
    height = (index @ AFFINE[:, :3].T + AFFINE[:, 3] - MIDDLE) @ AXES[:, 2]
    labels = np.where(shown.values > 75.0, 1, np.where(shown.values > 25.0, 2, 0))
    return Volume(np.where(height < CUT, labels, 0).astype(np.uint8), AFFINE)


def zip_of_stl(sequence: MeshSequence) -> bytes:
    """Write each frame as binary STL, which states no unit."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as file:
        for k, vertices in enumerate(sequence.vertices):
            corners = vertices[sequence.faces].astype("<f4")
            facet = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("kind", "<u2")]
            rows = np.zeros(len(corners), dtype=facet)
            rows["corners"] = corners
            head = bytes(80) + len(rows).to_bytes(4, "little")
            file.writestr(f"frame-{k:02}.stl", head + rows.tobytes())
    return data.getvalue()
