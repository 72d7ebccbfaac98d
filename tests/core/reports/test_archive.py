"""Instances that an archive has kept come back with the same bytes. Needs Debian's orthanc."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from dicom_samples import study_instance
from norm_controls import beat
from project import ROOT

import modalmotion as mm
from modalmotion.formats.parser_child import ParserHere
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.reports import report_of
from modalmotion.reports.dicom import dicom_instances, read_study

pytest.importorskip("highdicom")

PORT = 8042
# It listens on every address, whatever it is told: so in a network of its own, where none is.
ALONE = ["unshare", "--user", "--map-root-user", "--net"]
SCRIPT = 'ip link set lo up && { Orthanc "$1" 2>/dev/null & } && shift && "$@"; kill $!; wait $!'


def can_be_alone() -> bool:
    """Whether there is an archive, and a network namespace can be made for it."""
    if any(shutil.which(name) is None for name in ("Orthanc", "unshare", "ip")):
        return False
    return subprocess.run([*ALONE, "true"], check=False, capture_output=True).returncode == 0


@pytest.mark.soak
@pytest.mark.skipif(
    not can_be_alone(), reason="needs apt-get install orthanc iproute2, and network namespaces"
)
def test_an_archive_returns_the_same_bytes(tmp_path: Path) -> None:
    study = read_study(study_instance(), parser=ParserHere(DEFAULT_LIMITS))
    paths = []
    for seed in range(4):
        sequence = beat(seed)
        facts = replace(sequence.facts, coordinates="LPS", cavity="lv", modality="MR")
        sequence = replace(sequence, unit="mm", facts=facts)
        signature = mm.modal_signature(sequence)
        made = report_of(signature, sequence, issued=datetime(2026, 1, 31, 12, tzinfo=UTC))
        for name, data in dicom_instances(made, study).items():
            paths.append(tmp_path / f"{seed}-{name}")
            paths[-1].write_bytes(data)
    (tmp_path / "kept").mkdir()
    settings = tmp_path / "orthanc.json"
    settings.write_text(
        json.dumps(
            {
                "StorageDirectory": str(tmp_path / "kept"),
                "IndexDirectory": str(tmp_path / "kept"),
                "HttpPort": PORT,
                "DicomPort": PORT + 1,
                "AuthenticationEnabled": False,
                "Plugins": [],
            }
        )
    )
    ask = [sys.executable, str(ROOT / "tests" / "support" / "ask_archive.py"), str(PORT)]
    done = subprocess.run(
        [*ALONE, "bash", "-c", SCRIPT, "-", str(settings), *ask, *map(str, paths)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.stdout.splitlines() == [f"{path.name}\tsame" for path in paths], done.stderr
