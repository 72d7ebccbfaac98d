"""A person's road through the pages of a service, in a real browser. Needs Chromium."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser, browser
from running import RunningService

from modalmotion_service.access.keys import KeyRing
from modalmotion_service.access.scopes import Scope


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    with browser() as started:
        yield started


def test_from_a_dropped_file_to_a_page_of_one_file(
    chromium: Browser, tmp_path: Path, beat: bytes
) -> None:
    (tmp_path / "beat.npz").write_bytes(beat)
    service = RunningService(
        tmp_path / "results", {"REQUIRE_KEYS": "true", "WORKERS": "1", "WAIT_SECONDS": "60"}
    ).start()
    try:
        with KeyRing(service.data_dir) as ring:
            token = ring.create("alice", frozenset({Scope.READ, Scope.WRITE}))[1]
        with chromium.open(service.base) as opened:
            page = opened.page
            # The key is typed in, and kept in no address and no storage.
            page.locator("dialog input").fill(token)
            page.keyboard.press("Enter")
            page.set_input_files("#file", tmp_path / "beat.npz")
            opened.shown()
            assert page.url.startswith(f"{service.base}/view/")
            assert token not in page.url
            kept = "JSON.stringify([localStorage, sessionStorage, document.cookie])"
            assert page.evaluate(kept) == '[{},{},""]'
            page.focus(".modes input")
            page.keyboard.press("Home")
            opened.wait("location.search.includes('gains=0')")
            assert "%" in page.locator(".readouts .big").text_content()
            page.get_by_role("button", name="Classify").click()
            opened.wait("document.querySelector('.class .big') !== null")
            for button, name in (("Table (CSV)", "table.csv"), ("Save as one file", "beat.html")):
                with page.expect_download() as started:
                    page.get_by_role("button", name=button).click()
                started.value.save_as(tmp_path / name)
            assert [url for url in opened.asked if not url.startswith(service.base)] == [
                url for url in opened.asked if url.startswith("blob:")
            ]
            # Only the answer that asked for the key was refused.
            refused = [text for text in opened.said if "401" not in text]
            assert refused == []
            # The list on the first page leads here too.
            page.go_back()
            page.locator("table a").click()
            opened.wait("location.pathname.startsWith('/view/')")
            address = page.url
        with chromium.open(address) as opened:
            opened.page.locator("dialog input").fill(token)
            opened.page.keyboard.press("Enter")
            opened.shown()
    finally:
        service.stop()
    assert (tmp_path / "table.csv").read_text().startswith("frame,time_s,mode,label")
    # The service is gone, and so is the network.
    with chromium.open((tmp_path / "beat.html").as_uri(), offline=True) as opened:
        opened.shown()
        assert opened.said == []
        assert opened.page.locator(".window").count() == 2
