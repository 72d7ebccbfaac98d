"""Models and templates that are only read lie in a folder of links."""

from __future__ import annotations

from pathlib import Path

import pytest

from modalmotion.errors import StoreError
from modalmotion_service.workspace.owners import lay_out


def test_models_and_templates_are_linked_and_nothing_else(tmp_path: Path) -> None:
    source, root = tmp_path / "kept", tmp_path / "served"
    for name in ("models/hers/1.h5", "templates/ab/one.h5", "sequences/cd/two.h5", "index.sqlite"):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_text(name)
    for _ in range(2):
        lay_out(source, root)
    served = {str(p.relative_to(root)): p for p in root.rglob("*") if not p.is_dir()}
    assert set(served) == {"models/hers/1.h5", "templates/ab/one.h5"}
    assert all(path.is_symlink() and path.read_text() == name for name, path in served.items())


def test_an_owner_without_a_store_has_nothing(tmp_path: Path) -> None:
    lay_out(tmp_path / "absent", tmp_path / "served")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="File name too long") as refused:
        lay_out(tmp_path / ("x" * 300), tmp_path / "served")
    assert "--read-only-dir" in str(refused.value.remedy)
    lay_out(tmp_path, tmp_path / "served")
