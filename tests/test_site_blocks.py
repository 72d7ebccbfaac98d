"""Commands and bodies on pages that no test of their subject runs: each runs, or is accepted."""

from __future__ import annotations

import csv
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import click
import jsonschema
import pytest
from click.testing import CliRunner
from dicom_samples import study_instance
from norm_controls import beat
from project import ROOT
from running import RunningService

import modalmotion as mm
from modalmotion.cli import main
from modalmotion.formats import write_npz


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / "docs" / page).read_text()
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the pages name, but for images: tests of tracking have those."""
    folder = tmp_path_factory.mktemp("pages")
    for k in range(19):
        (folder / f"{k}.npz").write_bytes(write_npz(beat(k)))
    with (folder / "controls.csv").open("w", newline="") as file:
        csv.writer(file).writerows([["path", "subject"], *([f"{k}.npz", k] for k in range(19))])
    for k, name in enumerate(("beat.npz", "one.npz", "two.zip"), start=19):
        mm.save(beat(k), folder / name)
    (folder / "patients.csv").write_text("path,subject\none.npz,P 1\ntwo.zip,P 2\n")
    (folder / "image.dcm").write_bytes(study_instance())
    return folder


COMMANDS = [
    line
    for page in ("norms.md", "interoperability.md")
    for block in blocks(page, "sh")
    for line in block.splitlines()
]


def test_commands_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("highdicom")
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(folder)
    n_run = 0
    for line in COMMANDS:
        words = shlex.split(line)[1:]
        if "map.nii.gz" in words or "study/" in words:
            continue
        done = CliRunner().invoke(main, words)
        assert done.exit_code == 0, f"{line}: {done.output}"
        n_run += 1
    assert n_run == 4


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_and_their_options_exist(line: str) -> None:
    words = shlex.split(line)[1:]
    command: click.Command | None = main
    while isinstance(command, click.Group):
        command = command.get_command(click.Context(command), words.pop(0))
    assert command is not None
    known = {name for option in command.params for name in option.opts}
    assert {word for word in words if word.startswith("-")} <= known


def test_requests_of_the_page_on_the_service_are_answered(folder: Path, tmp_path: Path) -> None:
    if shutil.which("curl") is None:
        pytest.skip("curl is absent")
    service = RunningService(tmp_path / "served", {"WORKERS": "1"}).start()
    identity = ""
    try:
        for block in blocks("service.md", "sh"):
            line = block.strip().replace("localhost:8000", f"127.0.0.1:{service.port}")
            done = subprocess.run(
                shlex.split(line.replace("$ID", identity)),
                cwd=folder,
                capture_output=True,
                check=True,
            )
            answer = json.loads(done.stdout)
            # A problem, or the results of a batch, of which none failed.
            assert "status" not in answer, answer
            assert not any("problem" in one for one in answer.get("results", [])), answer
            identity = answer.get("id", identity)
    finally:
        service.stop()
    assert re.fullmatch("[0-9a-f]{64}", identity)


@pytest.mark.parametrize(
    ("page", "number", "method", "path"),
    [
        ("service.md", 0, "patch", "/v1/sequences/{sequence_id}"),
        ("service.md", 1, "post", "/v1/models"),
        ("service.md", 2, "post", "/v1/features"),
        ("norms.md", 0, "post", "/v1/norms"),
    ],
)
def test_bodies_are_those_of_the_interface(page: str, number: int, method: str, path: str) -> None:
    interface = json.loads((ROOT / "openapi" / "openapi.json").read_text())
    content = interface["paths"][path][method]["requestBody"]["content"]
    schema = next(iter(content.values()))["schema"]
    body = json.loads(blocks(page, "json")[number].replace("<id>", "0" * 64))
    jsonschema.validate(body, {**schema, "components": interface["components"]})
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(
            {**body, "unknown": 1}, {**schema, "components": interface["components"]}
        )
