"""Print how many files of the service a request runs through: an upload, its signature, its class.

Those of the server's own process; what its workers run is the library's, but for the tasks.
"""

from __future__ import annotations

import tempfile
import threading
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from fastapi.testclient import TestClient

from modalmotion import simulate_ventricle, write_npz
from modalmotion_service.app import create_app
from modalmotion_service.settings import Settings


def main() -> None:
    """Trace the second upload, when all that is lazy is there."""
    seen: set[str] = set()

    def note(frame: FrameType, _event: str, _argument: Any) -> None:
        seen.add(frame.f_code.co_filename)

    threading.setprofile(note)
    with tempfile.TemporaryDirectory() as place:
        settings = Settings(data_dir=Path(place), wait_seconds=120.0)
        with TestClient(create_app(settings)) as client:
            for seed in range(2):
                seen.clear()
                beat = simulate_ventricle(rng=np.random.default_rng(seed))
                sent = client.post("/v1/sequences", content=write_npz(beat)).json()
                path = f"/v1/sequences/{sent['id']}"
                client.get(f"{path}/signature").raise_for_status()
                client.post(f"{path}/classifications", json={}).raise_for_status()
        threading.setprofile(None)
    print(sum("/modalmotion_service/" in name for name in seen))


if __name__ == "__main__":
    main()
