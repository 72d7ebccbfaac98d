"""The document that describes the interface: what it has where a package is absent."""

from __future__ import annotations

import subprocess
import sys

from modalmotion_service.app import create_app

DICOM = "/v1/signatures/{key}/dicom"
WITHOUT = f"""
import sys
sys.modules["highdicom"] = None
from modalmotion_service.app import create_app
sys.exit(0 if {DICOM!r} in create_app().openapi()["paths"] else 3)
"""


def test_an_operation_is_described_where_its_extra_is_installed() -> None:
    assert DICOM in create_app().openapi()["paths"]
    assert subprocess.run([sys.executable, "-c", WITHOUT], check=False).returncode == 3
