"""Print how many files of the product a call runs through, when all that is lazy is there.

    python benchmarks/traced.py signature|classify|upload

An upload goes on to its signature and its class. Its files are those of the service in the server's
own process; what its workers run is the library's, but for the tasks.
"""

from __future__ import annotations

import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from fastapi.testclient import TestClient

import modalmotion as mm
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings


def main(name: str) -> None:
    """Trace the second call."""
    seen: set[str] = set()

    def note(frame: FrameType, _event: str, _argument: Any) -> None:
        seen.add(frame.f_code.co_filename)

    calls: dict[str, AbstractContextManager[Callable[[mm.MeshSequence], object]]] = {
        "signature": nullcontext(mm.modal_signature),
        "classify": nullcontext(mm.classify),
        "upload": uploading(),
    }
    threading.setprofile(note)
    with calls[name] as call:
        for seed in range(2):
            beat = mm.simulate_ventricle(rng=np.random.default_rng(seed))
            seen.clear()
            sys.setprofile(note)
            call(beat)
            sys.setprofile(None)
    part = "/modalmotion_service/" if name == "upload" else "/modalmotion/"
    print(sum(part in path for path in seen))


@contextmanager
def uploading() -> Iterator[Callable[[mm.MeshSequence], object]]:
    """Serve, and give what takes a beat from upload to class."""
    with tempfile.TemporaryDirectory() as place:
        settings = Settings(data_dir=Path(place), wait_seconds=120.0)
        with TestClient(create_app(settings)) as client:

            def upload(beat: mm.MeshSequence) -> None:
                sent = client.post("/v1/sequences", content=mm.write_npz(beat)).json()
                made = client.post(f"/v1/sequences/{sent['id']}/signatures").raise_for_status()
                here = f"/v1/signatures/{made.json()['key']}"
                client.post(f"{here}/classifications").raise_for_status()

            yield upload


if __name__ == "__main__":
    main(sys.argv[1])
