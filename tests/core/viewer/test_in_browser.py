"""The viewer in a real browser: right, strict, usable by everyone. Needs Chromium."""

from __future__ import annotations

import base64
import csv
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, Opened, browser
from clouds import breathing_spheroid, sampled
from project import ROOT
from viewed_surfaces import VIEWED, scaled, viewed

from modalmotion.classification import classify
from modalmotion.codec import decode, encode
from modalmotion.mesh.alignment import reference_positions
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import fitted_on, reconstruct
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.template.body_frame import Direction, directions_on
from modalmotion.tracking import track
from modalmotion.viewer.container import read_container
from modalmotion.viewer.page import View, script, style, view_page

AXE = ROOT / "viewer" / "node_modules" / "axe-core" / "axe.min.js"
FRAMES = (0, 2, 4)
ROWS = "h1, .readouts h2, .readouts .big, .readouts .figures tr"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as started:
        yield started


@pytest.fixture(scope="module")
def page_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """Write a page and give its address."""
    folder = tmp_path_factory.mktemp("pages")

    def write(*views: View) -> str:
        path = folder / f"{len(list(folder.iterdir()))}.html"
        path.write_text(view_page(views))
        return path.as_uri()

    return write


@pytest.fixture(scope="module")
def beat_page(page_of: Callable[..., str]) -> str:
    beat = simulate_ventricle(grid=(12, 24), acquisition=Acquisition(n_frames=12))
    return page_of(View(modal_signature(beat), beat, "a beat", classification=classify(beat)))


@pytest.fixture(scope="module")
def wide(chromium: Browser, beat_page: str) -> Iterator[Opened]:
    """The beat's page, for tests that do not hang on what others have done on it."""
    with chromium.open(beat_page, viewport={"width": 1280, "height": 800}) as opened:
        yield opened.shown()


def test_read_outs_are_there_before_the_script_and_the_same(
    chromium: Browser, beat_page: str, wide: Opened
) -> None:
    with chromium.open(beat_page, java_script_enabled=False) as still:
        first = [one.inner_text() for one in still.page.query_selector_all(ROWS)]
        assert still.page.query_selector(".still img").bounding_box()["height"] > 100
    later = [one.inner_text() for one in wide.page.query_selector_all(ROWS)]
    assert wide.page.query_selector(".still") is None
    assert len(first) > 6
    assert [text.split() for text in first] == [
        text.replace("−", "-").replace("Quantity", "").replace("Value", "").split()
        for text in later
    ]


def test_a_compressed_stream_plays(chromium: Browser, page_of: Callable[..., str]) -> None:
    sequence, _ = viewed("cup")
    stream = encode(sequence, rms=0.01).data
    decoded = decode(stream)
    view = View(modal_signature(decoded), decoded, stream=stream)
    with chromium.open(page_of(view)) as opened:
        opened.shown()
        require_drawn(opened, 0, view)
        assert opened.said == []


@pytest.mark.every(4)
@pytest.mark.parametrize(
    ("names", "draw"),
    [*((VIEWED[k : k + 2], "sum") for k in range(0, len(VIEWED), 2)), (("cup", "mesh"), "shader")],
)
def test_what_is_drawn_is_what_the_library_reconstructs(
    chromium: Browser, page_of: Callable[..., str], names: tuple[str, ...], draw: str
) -> None:
    views = [View(signature, sequence) for sequence, signature in map(viewed, names)]
    with chromium.open(f"{page_of(*views)}?draw={draw}") as opened:
        opened.shown()
        for number, view in enumerate(views):
            surfaces = f"modalmotion.surfaces[{number}]"
            is_in_shader = opened.page.evaluate(f"{surfaces}.isInShader")
            assert is_in_shader == (draw == "shader")
            require_drawn(opened, number, view)
        assert opened.said == []


def require_drawn(opened: Opened, number: int, view: View) -> None:
    """Compare positions and colours as drawn with the library's, with some modes changed."""
    header, arrays = read_container(view.payload())
    start = reference_positions(view.sequence, 0)
    centre = start[0] - arrays["rest"][0]
    extent = float(np.ptp(start, axis=0).max())
    n = len(header["waves"])
    for gains in (np.ones(n), np.arange(n) % 2, np.linspace(0, 3, n)):
        of_modes = np.empty(len(view.signature.modes))
        for gain, wave in zip(gains, header["waves"], strict=True):
            of_modes[wave["modes"]] = gain
        true = reconstruct(scaled(view.signature, of_modes), view.sequence)
        for frame in FRAMES:
            here = f"{number}, 'superposed', {frame}, {json.dumps(gains.tolist())}, 1"
            drawn = opened.page.evaluate(f"modalmotion.read({here})")
            shown = np.array(drawn["positions"]).reshape(-1, 3) + centre
            assert np.abs(shown - true[frame]).max() <= 1e-4 * extent
            distance = np.linalg.norm(true[frame] - view.sequence.vertices[frame], axis=1)
            assert np.abs(np.array(drawn["values"]) - distance).max() <= 0.005
    sent = opened.page.evaluate(f"modalmotion.read({number}, 'sent', 2, [], 0)")
    own = np.array(sent["positions"]).reshape(-1, 3) + centre
    assert np.abs(own - view.sequence.vertices[2]).max() <= 0.002


def test_a_page_of_one_file_asks_for_nothing_and_says_nothing(
    chromium: Browser, beat_page: str
) -> None:
    with chromium.open(beat_page) as opened:
        opened.shown()
        assert opened.asked == [beat_page]
        assert opened.said == []
        # What the page may not do is refused, and would be seen here.
        opened.page.evaluate("fetch('http://127.0.0.1:9/').catch(() => null)")
        assert any("Content Security Policy" in text for text in opened.said)
        parsed = "try { document.body.innerHTML = '<b>x</b>' } catch { return 'refused' }"
        assert opened.page.evaluate(f"(() => {{ {parsed} }})()") == "refused"


def test_data_are_drawn_over_the_surface_that_they_gave(
    chromium: Browser, page_of: Callable[..., str]
) -> None:
    beat, rng = breathing_spheroid(3), np.random.default_rng(2)
    clouds = [1e4 + sampled(x, beat.faces, 120, rng, 0.3) for x in beat.vertices]
    clouds[1][:10] += 30.0
    made = track(clouds, modes=7, unit="mm")
    signature = modal_signature(made.sequence)
    view = View(signature, made.sequence, data=made.data)
    with chromium.open(page_of(view)) as opened:
        opened.shown()
        opened.wait("modalmotion.clouds[0] !== null")
        centre = np.array(read_container(view.payload())[0]["centre"])
        for frame in range(3):
            drawn = np.array(opened.page.evaluate(f"modalmotion.clouds[0].read({frame})"))
            assert made.data is not None
            exact = made.data.points[made.data.of_frame(frame)] - centre
            assert np.abs(drawn.reshape(-1, 3) - exact).max() < 1e-4
        legend = opened.page.locator("label.sent", has_text="Show the data")
        assert legend.text_content() == "Show the data: countedleft out"
        seen = "modalmotion.clouds[0].drawn.map(one => one.visible)"
        opened.page.evaluate("modalmotion.seek(modalmotion.motions[0].timeAt(1))")
        opened.wait("modalmotion.clouds[0].geometry.drawRange.start === 120")
        assert opened.page.evaluate(seen) == [True] * 4
        legend.click()
        opened.wait(f"{seen}.every(one => !one)")
        assert opened.said == []


def focused(opened: Opened, most: int) -> list[str]:
    """Names of what Tab reaches, in order."""
    names = []
    for _ in range(most):
        opened.page.keyboard.press("Tab")
        name = opened.page.evaluate(
            "(() => { const e = document.activeElement; e.dataset.reached = 1;"
            "return e.getAttribute('aria-label') || e.textContent || e.value; })()"
        )
        names.append(name)
    return names


def test_everything_is_worked_by_keyboard(chromium: Browser, beat_page: str) -> None:
    with chromium.open(beat_page) as opened:
        opened.shown()
        page = opened.page
        names = focused(opened, 60)
        assert any("Arrow keys turn it" in name for name in names)
        # Of radio buttons the chosen one is reached, and arrows choose another.
        left_out = page.evaluate(
            "[...document.querySelectorAll('button, input, select, summary, [tabindex], a[href]')]"
            ".filter((e) => !e.disabled && e.type !== 'radio' && !e.closest('[hidden]')"
            " && e.checkVisibility() && !e.dataset.reached).map((e) => e.outerHTML)"
        )
        assert left_out == []
        page.focus("canvas")
        yaw = page.evaluate("modalmotion.stage.yaw")
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("+")
        assert page.evaluate("modalmotion.stage.yaw") != yaw
        assert page.evaluate("modalmotion.stage.zoom") > 1
        page.keyboard.press("Home")
        assert page.evaluate("modalmotion.stage.yaw") == yaw
        # A still page opens at end systole.
        frame = page.evaluate("modalmotion.header.volume.end_systole")
        page.keyboard.press(".")
        page.keyboard.press(",")
        page.keyboard.press(".")
        assert page.evaluate("Math.round(modalmotion.place(0))") == frame + 1
        page.keyboard.press(" ")
        assert page.evaluate("modalmotion.isPlaying")
        page.keyboard.press(" ")
        page.focus(".modes input")
        page.keyboard.press("ArrowRight")
        assert page.evaluate("modalmotion.gains[0][0]") == pytest.approx(1.05)
        page.focus("input[name=colour]:checked")
        page.keyboard.press("ArrowRight")
        assert page.evaluate("modalmotion.colour") == "motion"


def test_nothing_serious_stands_in_anyone_s_way(chromium: Browser, beat_page: str) -> None:
    if not AXE.is_file():
        pytest.skip("axe-core is absent: npm ci in viewer/ installs it")
    with chromium.open(beat_page, bypass_csp=True) as opened:
        page = opened.shown().page
        page.add_script_tag(path=str(AXE))
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
            serious = [
                (one["id"], [node["html"][:120] for node in one["nodes"]])
                for one in page.evaluate("axe.run()")["violations"]
                if one["impact"] in ("serious", "critical")
            ]
            assert (scheme, serious) == (scheme, [])


@pytest.mark.thorough
def test_a_lost_context_comes_back_with_the_same_picture(chromium: Browser, beat_page: str) -> None:
    with chromium.open(beat_page, device_scale_factor=1) as opened:
        page = opened.shown().page
        page.evaluate("modalmotion.seek(modalmotion.motions[0].times[4])")
        picture = "(() => { modalmotion.show(); return modalmotion.canvas.toDataURL(); })()"
        before = page.evaluate(picture)
        page.evaluate(
            "window.lost = modalmotion.stage.renderer.getContext()"
            ".getExtension('WEBGL_lose_context'); lost.loseContext()"
        )
        opened.wait("modalmotion.stage.isLost")
        page.evaluate("lost.restoreContext()")
        opened.wait("!modalmotion.stage.isLost")
        page.wait_for_timeout(100)
        after = page.evaluate(picture)
        assert len(before) > 20_000
        assert after == before


def test_a_frame_of_a_large_surface_is_little_work(
    chromium: Browser, page_of: Callable[..., str]
) -> None:
    still = standard_surface(Lattice(CUP, (20, 50)))
    frames = np.stack([still.vertices[0] * (1.0 - 0.1 * t) for t in (0.0, 1.0, 0.5)])
    sequence = mesh_sequence(frames, grid=still.grid, topology=CUP, unit="mm")
    signature = modal_signature(sequence, SignatureParameters(modes=21))
    with chromium.open(f"{page_of(View(signature, sequence))}?draw=shader") as opened:
        page = opened.shown().page
        page.evaluate("modalmotion.seek(1); modalmotion.show(); modalmotion.show()")
        counted = page.evaluate("""(() => {
            const gl = modalmotion.stage.renderer.getContext();
            let bytes = 0, draws = 0;
            const size = (x) => x && x.byteLength ? x.byteLength : 0;
            const undo = [];
            for (const name of ["bufferData", "bufferSubData", "texSubImage2D", "texImage2D",
                "drawElements", "drawArrays"]) {
              const own = gl[name].bind(gl);
              gl[name] = (...given) => {
                if (name.startsWith("draw")) draws++;
                else bytes += given.reduce((sum, one) => sum + size(one), 0);
                return own(...given);
              };
              undo.push(() => delete gl[name]);
            }
            modalmotion.seek(0.4);
            modalmotion.show();
            undo.forEach((one) => one());
            return { bytes, draws };
        })()""")
        # A panel for the frames as sent, and one for the superposition.
        assert counted["draws"] <= 2 * 2
        assert counted["bytes"] <= 2 * 2_048


def test_two_sequences_share_clock_camera_and_modes(
    chromium: Browser, page_of: Callable[..., str]
) -> None:
    views = [View(viewed(name)[1], viewed(name)[0], name) for name in ("cup", "cylinder")]
    with chromium.open(page_of(*views)) as opened:
        page = opened.shown().page
        assert page.locator(".window").count() == 4
        page.evaluate("modalmotion.seek(0.4)")
        places = page.evaluate("[modalmotion.place(0), modalmotion.place(1)]")
        assert places[0] == pytest.approx(places[1])
        page.evaluate("modalmotion.showOnly([2])")
        own, other = page.evaluate("modalmotion.gains.map((gains) => Array.from(gains))")
        labels = page.evaluate("modalmotion.motions.map((m) => m.header.waves.map((w) => w.label))")
        assert [label for label, gain in zip(labels[0], own, strict=True) if gain] == ["(0, 1)"]
        assert [label for label, gain in zip(labels[1], other, strict=True) if gain] == ["(0, 1)"]


def test_it_plays_by_itself_unless_still_pictures_are_preferred(
    chromium: Browser, beat_page: str
) -> None:
    with chromium.open(beat_page, reduced_motion="no-preference") as opened:
        opened.shown()
        assert opened.page.evaluate("modalmotion.isPlaying")
        opened.wait("modalmotion.time > 0")
        # All other tests prefer still pictures.
        opened.page.emulate_media(reduced_motion="reduce")
        opened.page.reload()
        opened.shown()
        assert not opened.page.evaluate("modalmotion.isPlaying")


def test_reasons_of_the_class_set_the_modes_and_a_narrow_page_has_all(
    chromium: Browser, beat_page: str
) -> None:
    with chromium.open(beat_page, viewport={"width": 380, "height": 800}) as opened:
        page = opened.shown().page
        sentence = page.locator(".class .sentence").text_content()
        assert re.match(r"Normal with probability\s(0\.\d\d|>\s0\.99); .+ at 90 %", sentence), (
            sentence
        )
        assert "object" not in page.locator(".class").text_content()
        page.get_by_text("What moved the answer").click()
        reason = page.locator(".reasons button:not(:disabled)").first
        assert re.search(r"[+\u2212]\d[\d.]* per mm$", reason.text_content())
        reason.click()
        gains = page.evaluate("Array.from(modalmotion.gains[0])")
        assert 0 < sum(gains) < len(gains)
        axial = page.locator(".modes li", has_text="(1, 0, cos)")
        axial.get_by_text("1 mm adds").click()
        effects = axial.locator("tr").all_text_contents()
        assert [row for row in effects if re.match(r"GLS\u2212[23]\.\d\d pointsz$", row)], effects
        wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0
        assert (
            "61" in page.locator(".readouts .big").text_content()
            or "62" in page.locator(".readouts .big").text_content()
        )


def test_read_outs_have_intervals_definitions_and_named_moments(
    wide: Opened,
) -> None:
    page = wide.page
    rows = page.locator(".readouts tbody tr").all_text_contents()
    names = ["EDV", "ESV", "SV", "GLS", "GCS", "GAS", "SDI"]
    assert [row.split("\u2212")[0].rstrip("0123456789. mlcyofth%\u00b1") for row in rows]
    for name, row in zip(names, rows, strict=True):
        assert row.startswith(name)
        assert " to " in row or "less than" in row
    page.get_by_text("Definitions").click()
    assert page.locator(".definitions dt:visible").all_text_contents() == ["EF", *names]
    # Both moments are named in both charts, and the bull's-eye says when it is.
    for title in ("Volume", "Strain"):
        chart = page.locator(".chart", has=page.get_by_role("heading", name=title))
        assert chart.locator(".tick.strong").all_text_contents()[:2] == ["ED", "ES"]
    rings = page.locator(".chart", has=page.get_by_role("heading", name="Rings"))
    before = rings.locator(".segment-text").all_text_contents()
    assert "at end systole" in rings.locator(".note").first.text_content()
    page.evaluate("modalmotion.seek(0)")
    page.wait_for_timeout(100)
    assert rings.locator(".segment-text").all_text_contents() == before
    heights = page.evaluate(
        "[...document.querySelectorAll('.chart > svg')].map(e => e.clientHeight)"
    )
    assert min(heights) >= 180


def test_a_mode_has_one_colour_and_dash_and_a_picture(wide: Opened) -> None:
    opened, page = wide, wide.page
    opened.wait("modalmotion.pictures.strips.every(Boolean)")
    opened.wait("modalmotion.pictures.drawn !== null")
    seen = page.evaluate("""(() => {
        const style = (e) => getComputedStyle(e);
        const bars = [...document.querySelectorAll('.level')].map(e =>
            style(e).backgroundColor);
        const rows = [...document.querySelectorAll('.modes li')].map(e =>
            e.querySelector('code').textContent.replace(', cos', ''));
        const ends = [...document.querySelectorAll('text.end')].filter(e =>
            e.textContent.startsWith('('));
        const curves = [...document.querySelectorAll('path.tone.curve')];
        const inked = [...document.querySelectorAll('.mode-picture')].map(e =>
            e.getContext('2d').getImageData(0, 0, e.width, e.height).data.some(x => x));
        return { bars: Object.fromEntries(rows.map((r, i) => [r, bars[i]])),
            ends: Object.fromEntries(ends.map(e => [e.textContent, style(e).fill])),
            dashes: curves.map(e => e.getAttribute('stroke-dasharray')), inked };
    })()""")
    assert len(seen["ends"]) == 5
    assert {name: seen["bars"][name] for name in seen["ends"]} == seen["ends"]
    assert len(set(seen["dashes"])) == 5
    assert all(seen["inked"])


def test_inward_motion_is_the_usual_colour_of_a_cavity_alone(
    chromium: Browser, page_of: Callable[..., str]
) -> None:
    sequence = simulate_ventricle(grid=(12, 24), acquisition=Acquisition(n_frames=12))
    signature = modal_signature(sequence)
    view = View(signature, sequence)
    header, _ = read_container(view.payload())
    start, end = header["volume"]["end_diastole"], header["volume"]["end_systole"]
    used = fitted_on(signature, sequence)
    outward = directions_on(used, Direction.NORMAL)
    true = reconstruct(signature, sequence)
    body = [
        (true[frame] - signature.translations[frame] - used.weights @ true[0])
        @ signature.rotations.matrices[frame]
        for frame in (start, end)
    ]
    expected = np.einsum("vd,vd->v", outward, body[0] - body[1])
    for draw in ("sum", "shader"):
        with chromium.open(f"{page_of(view)}?draw={draw}") as opened:
            opened.shown()
            assert opened.page.evaluate("modalmotion.colour") == "inward"
            gains = [1] * len(header["waves"])
            read = opened.page.evaluate(f"modalmotion.read(0, 'superposed', {end}, {gains}, 3)")
            shown = np.array(read["values"])
            assert np.median(shown) > 3.0
            # Normals of vertices are weighed otherwise by either side.
            assert np.abs(shown - expected).max() <= 0.05 * np.abs(expected).max()
    sheet, signature = viewed("plane")
    with chromium.open(page_of(View(signature, sheet))) as opened:
        assert opened.shown().page.evaluate("modalmotion.colour") == "motion"
        assert opened.page.locator("input[name=colour][value=inward]").count() == 0


@pytest.mark.thorough
def test_the_table_of_the_page_has_a_row_for_each_frame(
    chromium: Browser, beat_page: str, tmp_path: Path
) -> None:
    with chromium.open(beat_page) as opened:
        page = opened.shown().page
        with page.expect_download() as started:
            page.get_by_text("Table (CSV)").click()
        started.value.save_as(tmp_path / "table.csv")
        kept = page.evaluate("Array.from(modalmotion.motions[0].amplitudes)")
    with (tmp_path / "table.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert {"time_s", "volume_ml", "GLS_percent", "error_rms"} <= set(rows[0])
    written = [float(x) for row in rows for name, x in row.items() if name.startswith("(")]
    assert written == kept


@pytest.mark.parametrize("n_widgets", [4, pytest.param(20, marks=pytest.mark.soak)])
def test_widgets_on_a_page_all_show_their_surface(
    chromium: Browser, tmp_path: Path, n_widgets: int
) -> None:
    sequence, signature = viewed("cup")
    view = View(signature, sequence)
    held = [base64.b64encode(data).decode() for data in (view.payload(), *view.pieces())]
    # As a notebook does: the module's `render` for each cell, with a model to ask.
    text = f"""<!doctype html><meta charset="utf-8"><style>{style()}</style><body>
      <script>window.held = {json.dumps(held)};</script>
      <script type="module">
        {script()}
      </script></body>"""
    (tmp_path / "cells.html").write_text(text)
    with chromium.open((tmp_path / "cells.html").as_uri()) as opened:
        opened.page.evaluate(
            """async (n) => {
          const source = document.querySelector("script[type=module]").textContent;
          const address = URL.createObjectURL(new Blob([source], { type: "text/javascript" }));
          const { default: { render } } = await import(address);
          const view = (text) => new DataView(Uint8Array.from(atob(text), (c) =>
            c.charCodeAt(0)).buffer);
          const [payload, ...frames] = held.map(view);
          for (let k = 0; k < n; k++) {
            const el = document.createElement("div");
            document.body.append(el);
            render({ model: { get: (name) => ({ payload, frames })[name] }, el });
          }
        }""",
            n_widgets,
        )
        page = opened.page
        for cell in (0, n_widgets // 2, n_widgets - 1, 0):
            page.locator(".embedded").nth(cell).scroll_into_view_if_needed()
            opened.wait(
                f"document.querySelectorAll('.embedded')[{cell}].querySelector('.stage canvas')"
            )
        page.wait_for_timeout(200)
        assert page.locator(".embedded .stage canvas").count() <= 8
        assert not [text for text in opened.said if "error" in text or "Too many" in text]
