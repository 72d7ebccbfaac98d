"""Writes what the image installs, each file by its hash, from pip's own report.

::

    python tools/requirements.py

The versions are those of constraints.txt; the hashes are those of the wheels that pip would take
on each machine that the image is built for, with the Python that runs this.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any, Final

import compile_library

ROOT: Final = Path(__file__).resolve().parents[1]
EXTRAS: Final = ("service", "plot", "cluster", "images", "dicom", "oidc", "telemetry")
"""Of the project, that the image has."""
SLIM: Final = ("service",)
"""The same of a slim image: no pictures, images, DICOM, logins, traces, cluster."""
MACHINES: Final = ("x86_64", "aarch64")
"""That the image is built for."""

# Versions of the C library that the base image has at least, from the newest on.
_GLIBC: Final = ("2_28", "2_27", "2_26", "2_17", "2_12", "2_5")


def main() -> None:
    """Write both files."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    optional = project["project"]["optional-dependencies"]
    whole, slim = (
        [*project["project"]["dependencies"], *(one for extra in extras for one in optional[extra])]
        for extras in (EXTRAS, SLIM)
    )
    for name, needed in (
        ("requirements.txt", whole),
        ("requirements-slim.txt", slim),
        (
            "requirements-build.txt",
            [*project["build-system"]["requires"], compile_library.ZIG],
        ),
    ):
        (ROOT / name).write_text(text_of(needed))


def text_of(wanted: list[str]) -> str:
    """Give the lines of a requirements file, with the hashes for all machines."""
    hashes: dict[str, set[str]] = {}
    for machine in MACHINES:
        for one in report(wanted, machine):
            about = one["metadata"]
            digest = one["download_info"]["archive_info"]["hashes"]["sha256"]
            hashes.setdefault(f"{about['name']}=={about['version']}", set()).add(digest)
    lines = ["# Made by tools/requirements.py from constraints.txt."]
    for requirement in sorted(hashes, key=str.lower):
        options = [f"--hash=sha256:{digest}" for digest in sorted(hashes[requirement])]
        lines.append(" \\\n    ".join([requirement, *options]))
    return "\n".join(lines) + "\n"


def report(wanted: list[str], machine: str) -> list[dict[str, Any]]:
    """Give pip's report of what it would install on a machine."""
    platforms = [f"manylinux_{version}_{machine}" for version in _GLIBC]
    platforms.append(f"manylinux2014_{machine}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.json"
        subprocess.run(
            [
                *(sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed"),
                *("--quiet", "--disable-pip-version-check", "--report", str(file)),
                *("--constraint", str(ROOT / "constraints.txt"), "--only-binary=:all:"),
                *(word for platform in platforms for word in ("--platform", platform)),
                *("--target", folder, *wanted),
            ],
            check=True,
        )
        installed: list[dict[str, Any]] = json.loads(file.read_text())["install"]
    return installed


if __name__ == "__main__":
    main()
