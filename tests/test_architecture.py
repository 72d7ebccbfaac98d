"""Architecture: packages and imports are counted from the sources, and every module is tested."""

from __future__ import annotations

import tomllib
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from packages import ROOTS, Survey, survey, upward_imports
from tested_modules import TESTS, mirror_of, named_by, needing_tests, sources, steps_from

# How many packages (docs/decisions/0018-packages.md), and the most single modules at the root.
PACKAGES = {"modalmotion": (range(18, 31), 7), "modalmotion_service": (range(8, 20), 8)}


@pytest.fixture(scope="module", params=sorted(PACKAGES))
def counted_root(request: pytest.FixtureRequest) -> tuple[str, Survey]:
    return request.param, survey(request.param, ROOTS[request.param])


def test_there_are_no_cycles_and_no_upward_imports(counted_root: tuple[str, Survey]) -> None:
    _, counted = counted_root
    assert counted.package_cycles == []
    assert counted.module_cycles == []
    assert counted.upward_imports == []


def test_few_modules_are_outside_packages(counted_root: tuple[str, Survey]) -> None:
    name, counted = counted_root
    expected, most_single = PACKAGES[name]
    assert len(counted.packages) in expected
    assert len(counted.single) <= most_single, counted.single


TREE = {
    "__init__.py": "from pkg.roof.a import A",
    "cellar/__init__.py": "",
    "cellar/a.py": "def late():\n    from pkg.cellar import b",
    "cellar/b.py": "",
    "cellar/typed.py": (
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from pkg.roof.a import A"
    ),
    "roof/__init__.py": "",
    "roof/a.py": "import pkg.cellar.b\nA = 1",
    "roof/named.py": "TASK = 'modalmotion_pkg.cellar.a:late'",
    "loose.py": "",
}


def made_up(folder: Path, **changes: str) -> Survey:
    for name, text in (
        TREE | {k.replace("__", "/") + ".py": v for k, v in changes.items()}
    ).items():
        path = folder / "modalmotion_pkg" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.replace("pkg.", "modalmotion_pkg.").replace("_modalmotion_", "_"))
    return survey("modalmotion_pkg", folder / "modalmotion_pkg")


def test_every_kind_of_import_counts(tmp_path: Path) -> None:
    counted = made_up(tmp_path)
    name = "modalmotion_pkg."
    assert counted.modules[f"{name}cellar.a"] == {f"{name}cellar.b"}
    assert counted.modules[f"{name}cellar.typed"] == {f"{name}roof.a"}
    assert counted.modules[f"{name}roof.named"] == {f"{name}cellar.a"}
    assert counted.packages == ["cellar", "roof"]
    assert counted.single == ["loose"]


def test_cycles_are_found(tmp_path: Path) -> None:
    counted = made_up(tmp_path)
    assert counted.package_cycles == [["cellar", "roof"]]
    assert counted.module_cycles == []
    counted = made_up(tmp_path, cellar__b="def later():\n    import pkg.cellar.a")
    assert counted.module_cycles == [["modalmotion_pkg.cellar.a", "modalmotion_pkg.cellar.b"]]


def test_imports_of_higher_or_equal_layers_are_found(tmp_path: Path) -> None:
    nodes = made_up(tmp_path).nodes
    assert upward_imports(nodes, [["roof"], ["cellar"], ["loose"]]) == ["cellar -> roof"]
    assert upward_imports(nodes, [["roof", "cellar"], ["loose"]]) == [
        "cellar -> roof",
        "roof -> cellar",
    ]
    # A package that no layer names counts too.
    assert upward_imports(nodes, [["roof"]]) == ["cellar -> roof", "roof -> cellar"]


def where() -> dict[str, str]:
    """Test file of each module that has none of its own name."""
    table: dict[str, list[str]] = tomllib.loads((TESTS / "where.toml").read_text())
    pairs = [(module, file) for file, modules in table.items() for module in modules]
    assert len(dict(pairs)) == len(pairs), "a module is listed twice"
    return dict(pairs)


def test_each_module_has_its_test_file_or_says_where_it_is_tested() -> None:
    modules = set(needing_tests())
    mirrored = {module for module in modules if mirror_of(module).is_file()}
    listed = where()
    assert modules - mirrored - listed.keys() == set(), "write a test file, or list them"
    assert listed.keys() & mirrored == set(), "have a test file of their own"
    assert listed.keys() - modules == set(), "are not modules"
    for module in mirrored:
        assert module in steps_from(mirror_of(module)), f"its test never reaches {module}"
    for module, file in listed.items():
        assert (TESTS / file).is_file(), file
        assert module in steps_from(TESTS / file), f"{file} never reaches {module}"


def test_what_a_test_leads_to_is_no_guess() -> None:
    test = TESTS / "core" / "numeric" / "test_scales.py"
    assert "modalmotion.numeric.scales" in named_by(test)
    assert not [name for name in steps_from(test) if name.startswith("modalmotion.store")]


def test_no_module_has_the_name_of_what_its_package_hands_out() -> None:
    # After an import of the module, the package would hand out the wrong one of the two.
    for name, path in sources().items():
        if path.name != "__init__.py":
            continue
        package = import_module(name)
        inside = {
            other.rpartition(".")[2] for other in sources() if other.rpartition(".")[0] == name
        }
        assert inside & set(getattr(package, "__all__", ())) == set(), name


def test_entry_points_name_the_module_that_holds_the_command() -> None:
    for entry in entry_points(group="modalmotion.commands"):
        assert entry.module in sources(), entry
        assert entry.load() is entry.load()
        assert entry.load().name == entry.name


def test_a_test_that_hangs_is_a_failure(pytestconfig: pytest.Config) -> None:
    assert 0 < float(pytestconfig.getini("timeout")) <= 300
    assert pytestconfig.pluginmanager.hasplugin("timeout")
