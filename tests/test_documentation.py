"""Documentation runs: every code block and every command of the README."""

from __future__ import annotations

import ast
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from project import ROOT
from running import RunningService

from modalmotion.cli import main


def blocks(document: str, language: str) -> list[str]:
    text = (ROOT / document).read_text()
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def commands(document: str) -> Iterator[str]:
    for block in blocks(document, "sh"):
        for line in block.splitlines():
            yield line.split("  #")[0].strip()


def test_the_readme_opens_with_the_two_commands() -> None:
    first = blocks("README.md", "sh")[0].splitlines()
    assert [line.split("  ")[0] for line in first] == ["make demo", "make test"]


def test_the_readmes_python_runs_and_says_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # It writes files.
    monkeypatch.chdir(tmp_path)
    service = RunningService(tmp_path / "served").start()
    try:
        run_the_readmes_python(service)
    finally:
        service.stop()


def run_the_readmes_python(service: RunningService) -> None:
    namespace: dict[str, object] = {}
    n_compared = 0
    for block in blocks("README.md", "python"):
        lines = block.replace(":8000", f":{service.port}").splitlines()
        for statement in ast.parse("\n".join(lines)).body:
            code = ast.unparse(statement)
            if not isinstance(statement, ast.Expr):
                exec(code, namespace)  # noqa: S102 (our own README)
                continue
            value = eval(code, namespace)  # noqa: S307 (our own README)
            stated = lines[(statement.end_lineno or 1) - 1].partition("  # ")[2].strip()
            if stated.endswith("(25, 7, 3)"):
                assert value == (25, 7, 3)
                n_compared += 1
            elif stated.startswith(("ModeLabel", "'")):
                assert repr(value) == stated
                n_compared += 1
    assert n_compared == 3


def test_the_table_of_extras_is_that_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    page = (ROOT / "docs/start.md").read_text()
    named = re.findall(r"^\| `(\w+)` \|", page, flags=re.MULTILINE)
    assert sorted(named) == sorted(project["optional-dependencies"])


def test_all_is_what_users_need_and_no_remedy_names_what_nobody_has_registered() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    (whole,) = extras["all"]
    inner = set(re.search(r"\[(.*)\]", whole)[1].split(","))  # type: ignore[index]
    sites = {"oidc", "telemetry", "cluster", "remote"}
    assert inner == extras.keys() - sites - {"all", "browser", "docs", "bench", "dev"}
    folders = ("core", "service", "docs")
    texts = [p for folder in folders for p in (ROOT / folder).rglob("*") if p.suffix in _TEXTS]
    assert not [p for p in (*texts, ROOT / "README.md") if "modalmotion[" in p.read_text()]


_TEXTS = (".py", ".md", ".ipynb", ".json")


def test_the_readme_is_short_and_its_table_names_commands_and_options_that_exist() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) <= 120
    rows = re.findall(r"^\| .+ \| `modalmotion (.+)` \|$", text, flags=re.MULTILINE)
    assert rows[0] == "report map.nii.gz -o out/"
    assert len(rows) >= 9
    for row in rows:
        words = shlex.split(row)
        command: click.Command | None = main
        while isinstance(command, click.Group):
            command = command.get_command(click.Context(command), words.pop(0))
        assert command is not None, row
        known = {name for option in command.params for name in option.opts}
        assert {word for word in words if word.startswith("-")} <= known, row


def test_the_picture_of_the_readme_moves_and_is_small() -> None:
    image = pytest.importorskip("PIL.Image")
    path = ROOT / "docs" / "figures" / "beat.gif"
    assert path.stat().st_size < 1_000_000
    with image.open(path) as picture:
        assert picture.n_frames == 25


def names_of_files(text: str) -> set[str]:
    """Paths in backticks; patterns and files that a command makes are none."""
    named = re.findall(r"`([\w./-]+)`", text)
    return {name for name in named if "/" in name.strip("/") or name.endswith(".py")}


def places(name: str) -> list[Path]:
    """Where a path of the guide may lead: in the library, in the service, at the root."""
    bases = (ROOT / "core/modalmotion", ROOT / "service/modalmotion_service", ROOT)
    return [base / name for base in bases if (base / name).exists()]


def test_every_path_of_the_guide_exists() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text()
    assert len(text.splitlines()) <= 120
    assert len(names_of_files(text)) > 100
    for name in names_of_files(text):
        # It lies beside a checkout.
        assert places(name) or name == "../shared/data", name


def test_each_step_of_a_file_has_its_type_where_the_guide_says() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text()
    steps = re.findall(r"^\| \d+b? \| .+ \| (.+) \| (.+) \|$", text, flags=re.MULTILINE)
    assert len(steps) == 11
    for where, results in steps:
        code = "".join(path.read_text() for name in names_of_files(where) for path in places(name))
        for kind in re.findall(r"`(\w+)`", results):
            assert kind in code, f"{kind}: {where}"


def test_the_changelog_begins_with_the_first_release_and_has_short_bullets() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    assert re.findall(r"^## (\S+)", text, flags=re.MULTILINE)[-1] == "1.0.0"
    for bullet in re.findall(r"^- .*(?:\n  .*)*", text, flags=re.MULTILINE):
        assert bullet.count("\n") < 3, bullet


@pytest.mark.parametrize("document", ["README.md", "CONTRIBUTING.md"])
def test_documented_make_targets_exist(document: str) -> None:
    makefile = (ROOT / "Makefile").read_text()
    named = [command.split()[1] for command in commands(document) if command.startswith("make ")]
    assert named
    for target in named:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


# How often something is repeated is not what the README shows.
FEWER = {"train": ["--repetitions", "1", "--card", "quick"]}


def run_command(command: str, is_first: bool) -> str:
    """Run a command here; the first by the program that is installed, in a process of its own."""
    program, *arguments = command.split()
    arguments += FEWER.get(arguments[0], []) if program == "modalmotion" else []
    if program == "modalmotion" and not is_first:
        done = CliRunner().invoke(main, arguments)
        assert done.exit_code == 0, f"{command}: {done.output}"
        return done.stdout
    if program == "modalmotion":
        program = str(Path(sys.executable).parent / program)
    run = subprocess.run([program, *arguments], capture_output=True, text=True, check=False)
    assert run.returncode == 0, f"{command}: {run.stderr}"
    return run.stdout


def test_the_readmes_commands_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    service = RunningService(tmp_path / "served")
    n_run = 0
    try:
        for command in commands("README.md"):
            if command.startswith(("make ", "pip ")):
                continue
            if command == "modalmotion serve &":
                service.start()
                continue
            is_curl = command.startswith("curl ")
            if is_curl and shutil.which("curl") is None:
                continue
            said = run_command(command.replace(":8000/", f":{service.port}/"), n_run == 0)
            n_run += 1
            if is_curl:
                assert '"n_frames":25' in said
    finally:
        service.stop()
    assert {"beat.npz", "beat.h5", "beat.png", "out"} <= {path.name for path in tmp_path.iterdir()}


def test_links_between_documents_lead_somewhere() -> None:
    # Without what a build of the site writes.
    for document in [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").glob("[!_]*/*.md"),
        *(ROOT / "docs").glob("*.md"),
    ]:
        for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text()):
            assert (document.parent / target).exists(), f"{document.name}: {target}"
