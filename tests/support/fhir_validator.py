"""The validator of HAPI FHIR, where Java and Maven are; it asks no server about codes."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from modalmotion.reports import content as codes

HERE = Path(__file__).parent / "hapi"
TOOLS = ("mvn", "java")
with_hapi = pytest.mark.skipif(
    any(shutil.which(name) is None for name in TOOLS),
    reason="needs Maven and a Java development kit: apt-get install maven",
)


def complaints(bundles: Mapping[str, Mapping[str, Any]], folder: Path) -> list[str]:
    """Errors and warnings about bundles, one a line: file, severity, place, message."""
    for name, contents in (
        ("codes", {f"{k}": one for k, one in enumerate(codes.code_systems())}),
        ("bundles", bundles),
    ):
        (folder / name).mkdir()
        for key, resource in contents.items():
            (folder / name / f"{key}.json").write_text(json.dumps(resource))
    path = folder / "classpath"
    build = ["mvn", "-q", "-B", "dependency:build-classpath", f"-Dmdep.outputFile={path}"]
    subprocess.run(build, cwd=HERE, check=True, timeout=240, stdout=subprocess.DEVNULL)
    command = ["java", "-cp", path.read_text(), str(HERE / "Validate.java")]
    done = subprocess.run(
        [*command, str(folder / "codes"), str(folder / "bundles")],
        capture_output=True,
        text=True,
        check=False,
        timeout=280,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    lines = done.stdout.splitlines()
    assert sum(line.endswith("\tdone") for line in lines) == len(bundles)
    return [line for line in lines if not line.endswith("\tdone")]
