"""What must hold of the project as a whole."""

from __future__ import annotations

import ast
import importlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest
import yaml
from project import ROOT

import modalmotion


def tracked_files() -> list[Path]:
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def modules_of(statement: str) -> set[str]:
    code = f"import sys; {statement}; print('\\n'.join(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def imported_by(statement: str) -> set[str]:
    return {name.split(".")[0] for name in modules_of(statement)}


def test_importing_the_library_pulls_in_only_numpy_and_scipy() -> None:
    heavy = {"h5py", "sklearn", "matplotlib", "click", "fastapi", "pydantic", "pandas"}
    assert not imported_by("import modalmotion") & heavy


def test_help_and_the_bare_import_wait_for_nothing() -> None:
    heavy = {"numpy", "scipy", "h5py", "fastapi", "pydantic", "httpx2"}
    assert not imported_by("import modalmotion; from modalmotion.cli import main") & heavy
    assert (
        not imported_by(
            "from modalmotion.cli import main; "
            "main(['--help'], standalone_mode=False) if 'modalmotion' in sys.modules else None"
        )
        & heavy
    )


def test_a_server_starts_without_what_its_workers_need() -> None:
    # Of SciPy the name alone, whose parts are imported where they are used. Slow: it imports the
    # service in a process of its own.
    modules = modules_of("import modalmotion_service.commands.server")
    heavy = {"sklearn", "pandas", "matplotlib", "distributed", "joblib"}
    heavy |= {f"scipy.{part}" for part in ("fft", "linalg", "sparse", "spatial", "special")}
    assert "scipy" in modules
    assert not modules & heavy


def test_every_command_of_the_list_is_one_and_is_described() -> None:
    from modalmotion.cli import main
    from modalmotion.cli.commands import COMMANDS

    context = click.Context(main)
    listed = main.get_help(context)
    for name in COMMANDS:
        command = main.get_command(context, name)
        assert command is not None
        assert command.name == name
        # The list has the first line of what the command says of itself.
        first = (command.help or "").partition("\n")[0]
        assert len(first) > 20
        assert first in " ".join(listed.split())


@pytest.mark.parametrize("package", ["modalmotion", "modalmotion_service"])
def test_public_names_are_a_sorted_list_of_what_exists(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__all__ == sorted(module.__all__)
    assert dir(module) == module.__all__ or package != "modalmotion"
    for name in module.__all__:
        assert getattr(module, name).__doc__ or name.isupper()


def test_each_public_name_is_said_once() -> None:
    path = ROOT / "core" / "modalmotion" / "__init__.py"
    lists = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.If)]
    said = [
        (alias.name, alias.asname)
        for node in ast.walk(lists[0])
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]
    assert len(lists) == 1
    # `as` the same name is how type checkers are told that it is handed out.
    assert all(name == as_name for name, as_name in said)
    assert sorted(name for name, _ in said) == modalmotion.__all__
    for name, _ in said:
        assert len(re.findall(rf"\b{name} as {name}\b", path.read_text())) == 1, name
    assert {"read_sequence", "classify", "load_model"} <= set(modalmotion.__all__)


def test_no_file_names_a_registry_or_a_path_of_a_machine() -> None:
    hosts = ["pypi" + ".org", "pythonhosted" + ".org", "docker" + ".io", "registry" + ".npmjs"]
    paths = re.compile(r"(?<![\w.])/(?:work|root|home/\w+)/(?!/)[\w.]")
    for path in tracked_files():
        text = path.read_bytes().decode("utf-8", "ignore")
        assert not [host for host in hosts if host in text], path
        if path != Path(__file__):
            assert not paths.search(text), path


def test_no_real_sequence_is_committed() -> None:
    assert not [
        path for path in tracked_files() if path.suffix == ".npz" and "data" not in path.parts
    ]


def test_the_committed_openapi_file_is_what_the_code_says() -> None:
    from modalmotion_service.commands.openapi import document

    committed = (ROOT / "openapi" / "openapi.json").read_text()
    assert json.loads(committed)["info"]["title"] == "modalmotion"
    assert committed == document(), "run `make openapi`"


def test_every_constraint_pins_one_version() -> None:
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        assert re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.+!]+", line), line


def compose() -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
    return loaded


def test_compose_publishes_to_this_machine_only_and_keeps_results() -> None:
    service = compose()["services"]["modalmotion"]
    assert all(port.startswith("127.0.0.1:") for port in service["ports"])
    assert service["read_only"] is True
    volume, _, folder = service["volumes"][0].partition(":")
    assert volume in compose()["volumes"]
    dockerfile = (ROOT / "Dockerfile").read_text()
    data_dir = re.search(r"MODALMOTION_DATA_DIR=(\S+)", dockerfile)
    assert data_dir is not None
    assert data_dir[1].startswith(folder)


def test_the_image_holds_everything_it_copies_and_runs_as_nobody_special() -> None:
    dockerfile = (ROOT / "Dockerfile").read_text()
    allowed = {
        line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line[:1] == "!"
    }
    for line in re.findall(r"^COPY (?!--from)(.+)$", dockerfile, flags=re.MULTILINE):
        *sources, _ = line.split()
        for source in sources:
            assert (ROOT / source).exists(), source
            assert source in allowed, source
    assert re.search(r"^USER modalmotion$", dockerfile, flags=re.MULTILINE)
    health = re.search(r"127\.0\.0\.1:8000(/[\w/]+)", dockerfile)
    assert health is not None
    from modalmotion_service.app import create_app

    assert health[1] in create_app().openapi()["paths"]


def test_benches_find_real_recordings_in_one_place() -> None:
    for path in (ROOT / "benchmarks").glob("*.py"):
        text = path.read_text()
        assert '"shared"' not in text, path
        assert "MODALMOTION_DATA" not in text or path.name == "real_data.py", path


def test_a_bench_without_its_recordings_says_what_it_skipped(tmp_path: Path) -> None:
    (tmp_path / "heart").mkdir()
    (tmp_path / "heart" / "ring.npz").touch()
    code = (
        "import real_data as d; print(d.is_there('one', 'heart', 'heart/ring'), end='|');"
        "print(d.is_there('other', 'heart/lost'), end='|'); print(d.told())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT / "benchmarks",
        env={**os.environ, "MODALMOTION_DATA": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    there, absent, told = run.stdout.split("|")
    assert (there, absent) == ("True", "False")
    assert "other (heart/lost)" in told
    assert "one" not in told.splitlines()[1]
    assert str(tmp_path) in told
