"""Real Chromium, headless, with the pages' own policies; tests skip where it is absent."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

# Software rendering: no machine of a test has a graphics card that is alike.
ARGUMENTS = (
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    # The surface alone is drawn so; a page as a whole, drawn so too, takes several times as long.
    "--disable-gpu-rasterization",
    "--disable-gpu-compositing",
)
# What the software that draws says of itself: a surface is copied onto the page.
_STALLS = "GPU stall due to ReadPixels"


@dataclass
class Opened:
    """A page, and what it said and asked for while it was open."""

    page: Any
    said: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def hear(self, message: Any) -> None:
        if _STALLS not in message.text:
            self.said.append(f"{message.type}: {message.text}")

    def wait(self, condition: str) -> None:
        # Asked from outside: the pages' policy lets nothing inside evaluate a text.
        for _ in range(400):
            if self.page.evaluate(f"Boolean({condition})"):
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"{condition}; the page said {self.said}")

    def shown(self) -> Opened:
        """Wait until the surface is there, with the frames as sent."""
        self.wait("window.modalmotion?.motions?.every((m) => m.sent.isReady)")
        return self


@dataclass
class Browser:
    chromium: Any

    @contextmanager
    def open(self, url: str, **options: Any) -> Iterator[Opened]:
        """Open a page in a context of its own; of half as many dots a side as it has pixels.

        A processor draws them.
        """
        own = {"viewport": {"width": 720, "height": 480}, "reduced_motion": "reduce"}
        options = own | {"device_scale_factor": 0.5} | options
        context = self.chromium.new_context(**options)
        page = context.new_page()
        opened = Opened(page)
        page.on("console", opened.hear)
        page.on("pageerror", lambda error: opened.said.append(f"error: {error}"))
        page.on("request", lambda request: opened.asked.append(request.url))
        try:
            page.goto(url)
            yield opened
        finally:
            context.close()


@contextmanager
def browser() -> Iterator[Browser]:
    """Start Chromium, or skip the tests that need it."""
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("chromium is absent")
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=list(ARGUMENTS))
        try:
            yield Browser(chromium)
        finally:
            chromium.close()
