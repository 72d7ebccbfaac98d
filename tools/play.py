"""Writes the page of the site on which a simulated heart and its modes can be moved.

::

    python tools/play.py site/heart.html

The page has the viewer, the WebAssembly decoder and a compressed stream in one file. It is the
page that `modalmotion view` writes, packed by gzip once more as a whole: a short script unpacks
it in place, and the policy of the page itself then forbids every request.
"""

from __future__ import annotations

import base64
import gzip
import sys
from pathlib import Path
from typing import Final

import modalmotion as mm
from modalmotion.viewer.page import View, view_page

_PAGE: Final = """<!doctype html><html lang="en"><head><meta charset="utf-8">
<title>A simulated heart · modalmotion</title></head>
<body><noscript>This page needs JavaScript.</noscript>
<script type="application/octet-stream" id="packed">{packed}</script>
<script>
const text = document.getElementById("packed").textContent;
const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
new Response(stream).text().then((page) => {{
  document.open();
  document.write(page);
  document.close();
}});
</script></body></html>
"""


def sample_stream() -> bytes:
    """Simulate and encode a heart with a wall that hardly moves."""
    weak_wall = mm.VentricleParameters(akinesia=1.0)
    return mm.simulate_ventricle(weak_wall).encode(max_error=0.3).data


def play_page(stream: bytes) -> str:
    """Write the page of a compressed heart."""
    # Its vertices follow the tissue, as in tagging: the classes of a twist are offered too.
    beat = mm.decode(stream).with_facts(mm.Facts(tracking="material"))
    view = View(
        beat.signature(modes=18),
        beat,
        "A simulated heart",
        classification=beat.classify(),
        stream=stream,
    )
    packed = gzip.compress(view_page([view]).encode(), 9, mtime=0)
    return _PAGE.format(packed=base64.b64encode(packed).decode())


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(play_page(sample_stream()), encoding="utf-8")
