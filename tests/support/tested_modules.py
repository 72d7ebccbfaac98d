"""Which modules a test file leads to, and how near."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from packages import ROOTS, imports_of, modules_of, naming_nodes
from project import ROOT

import modalmotion
from modalmotion.arguments.public import homes_in
from modalmotion.cli.commands import COMMANDS

TESTS = ROOT / "tests"
SIDES = {"core": "modalmotion", "service": "modalmotion_service"}
_HELPERS = ("support", "slow_twins", "from_the_text", "extremes")


@cache
def sources() -> dict[str, Path]:
    """Every module of both roots by its dotted name."""
    return {
        name: path
        for root, folder in ROOTS.items()
        for name, path in modules_of(root, folder).items()
    }


@cache
def graph() -> dict[str, set[str]]:
    """What each module imports or names; the lazy public list is no import, a command is one."""
    modules = sources()
    imported = {
        name: set() if name == "modalmotion" else imports_of(path, modules)
        for name, path in modules.items()
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    added = project["entry-points"]["modalmotion.commands"].values()
    imported["modalmotion.cli.commands"] |= {
        *(f"modalmotion.cli.{module}" for module in COMMANDS.values()),
        *(entry.partition(":")[0] for entry in added),
    }
    return imported


def needing_tests() -> Iterator[str]:
    """Yield the modules that hold code of their own: packages only hand out."""
    for name, path in sources().items():
        if path.name not in ("__init__.py", "__main__.py"):
            yield name


def mirror_of(module: str) -> Path:
    """Give the test file that a module has by its name."""
    root, *packages, file = module.split(".")
    side = next(side for side, package in SIDES.items() if package == root)
    return TESTS.joinpath(side, *packages, f"test_{file}.py")


def named_by(path: Path) -> set[str]:
    """Give the modules that a test file imports or names, itself or through its helpers."""
    named: set[str] = set()
    files = [path]
    for file in files:
        modules, helpers = _said_in(file)
        named |= modules
        files += sorted(helpers - set(files))
    return named


@cache
def _said_in(path: Path) -> tuple[set[str], set[Path]]:
    """Modules that a file imports or names, and the helpers that it uses."""
    named = imports_of(path, sources())
    helpers: set[Path] = set()
    homes = homes_in(Path(modalmotion.__file__))
    for node in naming_nodes(path.read_text()):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id == "mm" and node.attr in homes:
                named.add(homes[node.attr])
        elif isinstance(node, ast.ImportFrom) and node.module:
            helpers |= _helper(node.module)
            if node.module == "modalmotion":
                named |= {homes[alias.name] for alias in node.names if alias.name in homes}
        elif isinstance(node, ast.arg) and node.arg in _fixtures():
            helpers |= _helper(_fixtures()[node.arg])
    return named, helpers


def _helper(module: str) -> set[Path]:
    paths = (TESTS / folder / f"{module}.py" for folder in _HELPERS)
    return {path for path in paths if path.is_file()}


@cache
def _fixtures() -> dict[str, str]:
    """Fixtures of all tests, and the helper that holds each."""
    imported = ast.parse((TESTS / "conftest.py").read_text()).body
    return {
        alias.name: node.module
        for node in imported
        if isinstance(node, ast.ImportFrom) and node.module and _helper(node.module)
        for alias in node.names
    }


@cache
def steps_from(path: Path) -> dict[str, int]:
    """Imports between a test file and each module it leads to; 0 for those that it names."""
    steps = dict.fromkeys(named_by(path), 0)
    waiting = list(steps)
    for module in waiting:
        for other in sorted(graph()[module] - steps.keys()):
            steps[other] = steps[module] + 1
            waiting.append(other)
    return steps
