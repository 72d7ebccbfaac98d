"""Wheels for all machines from this one, in dist/: `make wheels`.

Each is built twice, with nothing kept in between, and has to be the same file; its library exports
what the sources export and needs nothing. Only this machine's own is run by the tests.
"""

from __future__ import annotations

import hashlib
import os
import re
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
    """Build, check and list the wheels."""
    for target in library.TARGETS:
        if target == "wasm32":
            continue
        with tempfile.TemporaryDirectory() as folder:
            again = build(target, Path(folder)).read_bytes()
        wheel = build(target, ROOT / "dist")
        data = wheel.read_bytes()
        if data != again:
            sys.exit(f"{wheel.name} is another file when it is built again.")
        if len(data) > LARGEST_BYTES:
            sys.exit(f"{wheel.name} has {len(data)} bytes, over {LARGEST_BYTES}.")
        size = check_library(wheel)
        print(f"{hashlib.sha256(data).hexdigest()}  {len(data)}  {size}  {wheel.name}")


def build(target: str, folder: Path) -> Path:
    """Build the wheel for a target, without anything that an earlier build left."""
    with tempfile.TemporaryDirectory() as cache:
        done = subprocess.run(
            [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)],
            cwd=ROOT,
            env={
                **os.environ,
                library.VARIABLE: target,
                "ZIG_GLOBAL_CACHE_DIR": cache,
                "ZIG_LOCAL_CACHE_DIR": cache,
            },
            capture_output=True,
            text=True,
            check=False,
        )
    if done.returncode:
        sys.exit(done.stderr)
    (wheel,) = folder.glob(f"*-{library.TARGETS[target].platform}.whl")
    return wheel


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
