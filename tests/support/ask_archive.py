"""Sends files to an archive that runs here and prints those that come back with other bytes.

Run in the archive's network namespace: `python ask_archive.py PORT FILE...`.
"""

from __future__ import annotations

import http.client
import json
import sys
import time
from pathlib import Path


def answer(port: int, method: str, path: str, body: bytes | None = None) -> bytes:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    try:
        connection.request(method, path, body)
        response = connection.getresponse()
        data = response.read()
        assert response.status == 200, data
        return data
    finally:
        connection.close()


def main(port: int, *files: str) -> None:
    for _ in range(300):
        try:
            answer(port, "GET", "/system")
            break
        except OSError:
            time.sleep(0.1)
    for name in files:
        data = Path(name).read_bytes()
        kept = json.loads(answer(port, "POST", "/instances", data))["ID"]
        same = answer(port, "GET", f"/instances/{kept}/file") == data
        sys.stdout.write(f"{Path(name).name}\t{'same' if same else 'other'}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), *sys.argv[2:])
