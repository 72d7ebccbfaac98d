"""Wheels for all machines from this one and the sources, in dist/: `make wheels`.

Each is built twice, with nothing kept in between, and has to be the same file. The library of a
wheel exports what the sources export and needs nothing. Only this machine's own is run by the
tests. SOURCE_DATE_EPOCH is the date of all files, 2 February 2020 by default.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any, Final

import compile_library as library

ROOT: Final = Path(__file__).resolve().parents[1]

LARGEST_BYTES: Final = 5_000_000
# What the linker of macOS adds of itself, and what its compiler calls of libSystem for memset.
_OF_MACOS: Final = {"_mh_dylib_header", "__dso_handle", "dyld_stub_binder", "_bzero", "___bzero"}


def main() -> None:
    """Build, check and list the wheels and the sources."""
    dist = ROOT / "dist"
    dist.mkdir(exist_ok=True)
    for target in [*library.TARGETS, None]:
        if target == "wasm32":
            continue
        with tempfile.TemporaryDirectory() as folder:
            built, again = (build(target, Path(folder, name)) for name in ("built", "again"))
            data = built.read_bytes()
            if data != again.read_bytes():
                sys.exit(f"{built.name} is another file when it is built again.")
            file = Path(shutil.copy(built, dist))
        if len(data) > LARGEST_BYTES:
            sys.exit(f"{file.name} has {len(data)} bytes, over {LARGEST_BYTES}.")
        size = "-" if target is None else check_library(file)
        print(f"{hashlib.sha256(data).hexdigest()}  {len(data)}  {size}  {file.name}")


def build(target: str | None, folder: Path) -> Path:
    """Build the wheel for a target, or the sources, without anything that an earlier build left."""
    kind = "sdist" if target is None else "wheel"
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder)],
            cwd=ROOT,
            env={
                **os.environ,
                **({} if target is None else {library.VARIABLE: target}),
                "ZIG_GLOBAL_CACHE_DIR": cache,
                "ZIG_LOCAL_CACHE_DIR": cache,
            },
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        sys.exit(done.stderr)
    ending = ".tar.gz" if target is None else f"-{library.TARGETS[target].platform}.whl"
    (built,) = folder.glob(f"*{ending}")
    return built


def check_library(wheel: Path) -> int:
    """Check what a wheel's library exports and needs; give its bytes."""
    import lief

    lief.logging.disable()
    with zipfile.ZipFile(wheel) as opened:
        (name,) = (n for n in opened.namelist() if "/_native/" in n)
        data = opened.read(name)
    parsed: Any = lief.parse(data)
    exported = {function.name.removeprefix("_") for function in parsed.exported_functions}
    needed = {str(function.name) for function in parsed.imported_functions}
    # A relative relocation adds where the library lies, and names nothing.
    named = {r.symbol.name for r in parsed.relocations if getattr(r, "has_symbol", False)}
    if exported - _OF_MACOS != declared() or (needed | named) - _OF_MACOS:
        sys.exit(f"{wheel.name} exports {exported} for {declared()}, and needs {needed | named}.")
    return len(data)


def declared() -> set[str]:
    """Names that the sources export."""
    found = (
        re.findall(r"^MM_EXPORT\((\w+)\)", source.read_text(), re.MULTILINE)
        for source in library.sources()
    )
    return {name for names in found for name in names}


if __name__ == "__main__":
    main()
