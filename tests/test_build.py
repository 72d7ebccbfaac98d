"""The compiled library: who compiles it, of what, and what is said where nobody can."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from pathlib import Path

import compile_library as build
import pytest
from project import ROOT

from modalmotion.numeric import native

needs_compiler = pytest.mark.skipif(
    build.system_compiler() is None, reason="this machine has no C compiler"
)


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine without a compiler."""
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)


@pytest.fixture
def unoptimised(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A compiler of this machine that takes a tenth of the time."""
    compiler = tmp_path / "bin" / "unoptimised"
    compiler.parent.mkdir()
    compiler.write_text(f'#!/bin/sh\nexec {" ".join(build.system_compiler() or ())} "$@" -O0\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", str(compiler))


def sources_of(library: Path) -> str:
    stated = ctypes.CDLL(str(library)).mm_sources
    stated.restype = ctypes.c_char_p
    return bytes(stated()).decode()


def test_the_library_of_this_checkout_is_made_of_its_sources() -> None:
    native.library()
    assert native.PATH.name == f"modalmotion{build.suffix(None)}"
    assert sources_of(native.PATH) == build.digest()


@needs_compiler
@pytest.mark.usefixtures("unoptimised")
def test_sources_are_compiled_by_the_machine_and_say_which_they_are(tmp_path: Path) -> None:
    library = tmp_path / "folder" / "library"
    build.compile_library(library)
    assert sources_of(library) == build.digest()
    assert list(library.parent.iterdir()) == [library]


@needs_compiler
def test_the_sources_give_no_warning(tmp_path: Path) -> None:
    flags = [*build.FLAGS, "-Wall", "-Wextra", "-Wno-missing-field-initializers"]
    command = [*(build.system_compiler() or ()), *flags, "-Werror", "-fsyntax-only"]
    subprocess.run([*command, *map(str, build.sources())], cwd=tmp_path, check=True)


def test_zig_is_asked_for_only_where_it_is_needed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    hook = build.get_build_hook()(str(ROOT), {}, None, None, "", "wheel")
    monkeypatch.setattr(build, "system_compiler", lambda: ["cc"])
    assert hook.dependencies() == []
    monkeypatch.setenv(build.VARIABLE, "windows-amd64")
    assert hook.dependencies() == [build.ZIG]
    monkeypatch.delenv(build.VARIABLE)
    monkeypatch.setattr(build, "system_compiler", lambda: None)
    assert hook.dependencies() == [build.ZIG]


@pytest.mark.usefixtures("bare")
def test_a_compiler_that_compiles_nothing_is_none(tmp_path: Path) -> None:
    for name in ("cc", "gcc"):
        (tmp_path / name).write_text("#!/bin/sh\nexit 1\n")
        (tmp_path / name).chmod(0o755)
    assert shutil.which("cc") is not None
    assert build.system_compiler() is None


@pytest.mark.usefixtures("bare")
def test_without_any_compiler_the_remedy_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(build, "find_spec", lambda name: None)
    with pytest.raises(SystemExit, match=rf"Install cc, gcc or clang.*{build.ZIG}"):
        build.compile_library(tmp_path / "library", "linux-x86_64")
    monkeypatch.setattr(build, "this_machine", lambda: "plan9-mips")
    with pytest.raises(SystemExit, match=r"plan9-mips is not one of .*linux-x86_64"):
        build.compile_library(tmp_path / "library")
    assert not (tmp_path / "library").exists()


@needs_compiler
def test_a_source_that_does_not_compile_leaves_the_library_as_it_was(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    wrong = tmp_path / "wrong.c"
    wrong.write_text("int wrong(")
    library = tmp_path / "library"
    library.write_text("old")
    monkeypatch.setattr(build, "ROOT", tmp_path)
    monkeypatch.setattr(build, "sources", lambda pattern="": [wrong])
    with pytest.raises(SystemExit, match="could not compile"):
        build.compile_library(library)
    assert library.read_text() == "old"


@needs_compiler
@pytest.mark.usefixtures("unoptimised")
def test_a_wheel_is_of_no_version_of_python_and_holds_the_library_alone(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    environment = {k: v for k, v in os.environ.items() if k != build.VARIABLE}
    subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.stem.split("-")[2:4] == ["py3", "none"]
    assert wheel.stem.split("-")[4] != "any"
    shutil.unpack_archive(wheel, tmp_path / "unpacked", "zip")
    package = tmp_path / "unpacked" / "modalmotion"
    (library,) = (package / build.FOLDER).iterdir()
    assert sources_of(library) == build.digest()
    assert not [path for path in package.rglob("*") if path.suffix in (".c", ".h")]


def test_zig_has_one_version() -> None:
    assert build.ZIG in (ROOT / "constraints.txt").read_text().split()
