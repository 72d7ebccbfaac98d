"""A public list: its names are read from the text, and imported when they are used."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from modalmotion import store
from modalmotion.arguments.public import homes_in, public_list


def test_names_are_those_that_type_checkers_read(tmp_path: Path) -> None:
    path = tmp_path / "__init__.py"
    path.write_text(
        "if TYPE_CHECKING:\n"
        "    from modalmotion.representation import numeral as numeral\n"
        "    from modalmotion.representation import (\n        counted as counted,\n    )\n"
        "    from elsewhere import other as other\n"
    )
    package = {"__file__": str(path), "__name__": "made_up"}
    names, get, listed = public_list(package)
    assert names == listed() == ["counted", "numeral"]
    assert get("numeral") is package["numeral"]
    with pytest.raises(AttributeError, match="'made_up' has no attribute 'other'"):
        get("other")


def test_packages_within_are_found_by_their_names() -> None:
    # In a process of its own: here others have imported them.
    code = "import modalmotion as mm; print(mm.simulate.__name__, mm.tracking.track.__name__)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["modalmotion.simulate", "track"]


@pytest.mark.parametrize(
    ("name", "written"),
    [("signature", "modal_signature"), ("simulate", "simulate_ventricle"), ("template", "make_")],
)
def test_a_package_that_is_called_says_what_to_write(name: str, written: str) -> None:
    package = import_module(f"modalmotion.{name}")
    with pytest.raises(TypeError, match=f"is a package, not a function. Write .*{written}"):
        package(modes=7)  # type: ignore[operator]


def test_the_store_hands_out_all_that_it_names() -> None:
    path = Path(store.__file__)
    aliases = [
        alias.name
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname
    ]
    assert sorted(aliases) == store.__all__
    assert all(getattr(store, name) is not None for name in aliases)


def test_a_package_imports_what_is_used_of_it_and_no_more() -> None:
    homes = homes_in(Path(store.__file__))
    assert homes["write_atomic"] == "modalmotion.store.disk"
    code = "import sys; from modalmotion.store import write_atomic; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert loaded & set(homes.values()) == {"modalmotion.store.disk"}
