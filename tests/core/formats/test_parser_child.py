"""What a confined process cannot reach."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from modalmotion.formats.parser_child import landlock_version

pytestmark = pytest.mark.skipif(not landlock_version(), reason="this system has no Landlock")

TRIES = """
import ctypes, os, signal, socket, sys
from pathlib import Path
from modalmotion.formats.parser_child import confine, landlock_version
folder, port, parent = Path(sys.argv[1]), int(sys.argv[2]), os.getppid()
assert confine()
def refused(what, act):
    try:
        act()
    except PermissionError:
        return
    sys.exit(f"{what} was let through")
refused("reading", lambda: (folder / "secret").read_bytes())
refused("listing", lambda: list(folder.iterdir()))
refused("writing", lambda: (folder / "new").write_bytes(b""))
refused("reading /etc/passwd", lambda: open("/etc/passwd").read())
refused("linking", lambda: os.link(folder / "secret", folder / "other"))
refused("deleting", lambda: (folder / "secret").unlink())
refused("truncating", lambda: os.truncate(folder / "secret", 0))
refused("another's memory", lambda: open(f"/proc/{parent}/environ").read())
if landlock_version() >= 4:
    refused("connecting", lambda: socket.create_connection(("127.0.0.1", port)))
    refused("listening", lambda: socket.socket().bind(("127.0.0.1", 0)))
if landlock_version() >= 6:
    refused("signalling", lambda: os.kill(parent, 0))
# Its work is left to it.
import h5py, numpy, importlib.util
if importlib.util.find_spec("vtkmodules"):
    import vtkmodules.vtkIOXML
assert open("/proc/self/statm").read()
print("confined")
"""


def test_it_sees_python_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("of somebody")
    import socket

    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
        run = subprocess.run(
            [sys.executable, "-c", TRIES, str(tmp_path), str(port)],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    assert (run.returncode, run.stdout) == (0, "confined\n"), run.stderr
    assert (tmp_path / "secret").read_text() == "of somebody"
