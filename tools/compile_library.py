"""Build of the compiled library: C sources to one shared library within the package.

The sources are freestanding C11: no libc, nothing allocated, no Python. So the library depends on
the processor and on the form of its file alone, and the wheel on no version of Python. The
system's compiler makes it, or zig where there is none or the target is another machine:

    python tools/compile_library.py                     for a checkout, into it
    python tools/compile_library.py linux-aarch64 FILE  for one of TARGETS, to a file
    python tools/compile_library.py wasm32              the decoder that a browser runs
    MODALMOTION_TARGET=windows-x86_64 pip wheel --no-deps .
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NamedTuple

VARIABLE: Final = "MODALMOTION_TARGET"
ZIG: Final = "ziglang==0.17.1"
ROOT: Final = Path(__file__).resolve().parents[1]
FOLDER: Final = "_native"
WASM: Final = ROOT / "core" / "modalmotion" / "viewer" / "bundle" / "decode.wasm"
"""It is committed: a page may hold it, and only zig makes the same bytes everywhere."""

FLAGS: Final = (
    "-std=c11",
    "-O3",
    "-g0",
    "-ffreestanding",
    "-fno-math-errno",
    "-fvisibility=hidden",
    # The same bits on every machine: no product is fused with a sum.
    "-ffp-contract=off",
    "-nostdlib",
    "-s",
)
SHARED: Final = ("-shared", "-fPIC")


class Target(NamedTuple):
    """A machine that zig compiles for.

    Parameters
    ----------
    zig : str
        Processor, system, and how functions are called there, as zig names them.
    platform : str
        Tag of the wheel.
    suffix : str
        Of the library.
    flags : tuple of str
    sources : str
        Pattern of the sources.
    """

    zig: str
    platform: str
    suffix: str
    flags: tuple[str, ...] = SHARED
    sources: str = "*.c"


# Nothing in a library without libc tells glibc from musl.
_LINUX: Final = "manylinux_2_17_{0}.manylinux2014_{0}.musllinux_1_1_{0}"
_MACOS: Final = (*SHARED, "-Wl,-install_name,@rpath/modalmotion.dylib")
# Beside what the sources export: where the memory begins that a page may use.
_WASM: Final = (
    "-mbulk-memory",
    "-msimd128",
    # A third smaller, and no slower.
    "-fno-unroll-loops",
    *("-mllvm", "-inline-threshold=25"),
    "-Wl,--no-entry",
    "-Wl,--export=__heap_base",
    "-Wl,-z,stack-size=65536",
)
TARGETS: Final = {
    "linux-x86_64": Target("x86_64-linux-musl", _LINUX.format("x86_64"), ".so"),
    "linux-aarch64": Target("aarch64-linux-musl", _LINUX.format("aarch64"), ".so"),
    "darwin-arm64": Target("aarch64-macos.11.0", "macosx_11_0_arm64", ".dylib", _MACOS),
    "darwin-x86_64": Target("x86_64-macos.10.13", "macosx_10_13_x86_64", ".dylib", _MACOS),
    "windows-amd64": Target(
        "x86_64-windows-gnu", "win_amd64", ".dll", ("-shared", "-mno-stack-arg-probe")
    ),
    "wasm32": Target("wasm32-freestanding", "any", ".wasm", _WASM, "[df]*.c"),
}


def sources(pattern: str = "*.c") -> list[Path]:
    """List the sources of the library, in the same order everywhere."""
    return sorted((ROOT / "core" / "modalmotion").glob(f"*/native/{pattern}"))


def digest() -> str:
    """Digest of the sources, which the library states."""
    read = b"".join(source.read_bytes() for source in sources("*.[ch]"))
    return hashlib.sha256(read).hexdigest()[:16]


def system_compiler() -> list[str] | None:
    """Command of this machine's compiler, if it makes a library: $CC, cc, gcc or clang."""
    for words in filter(None, (os.environ.get("CC", "").split(), ["cc"], ["gcc"], ["clang"])):
        if shutil.which(words[0]) is None:
            continue
        # That of macOS without its tools only asks to install them.
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "empty.c").write_text("int empty;\n")
            command = [*words, *SHARED, "-o", f"{folder}/empty", f"{folder}/empty.c"]
            if subprocess.run(command, capture_output=True, check=False).returncode == 0:
                return words
    return None


def this_machine() -> str:
    """Name of this machine, as of `TARGETS` where zig serves it."""
    return f"{platform.system()}-{platform.machine()}".lower()


def compile_library(output: Path, target: str | None = None) -> None:
    """Compile the sources, for this machine if no target is stated.

    Raises
    ------
    SystemExit
        If there is no compiler, or it fails.
    """
    command = system_compiler() if target is None else None
    if command is not None:
        command = [*command, *SHARED]
    elif (made := TARGETS.get(target or this_machine())) is None:
        raise SystemExit(
            f"modalmotion: there is no C compiler, and {target or this_machine()} is not one of "
            f"{', '.join(TARGETS)}.\nInstall a C compiler (cc, gcc or clang), or name one in CC."
        )
    elif find_spec("ziglang") is None:
        raise SystemExit(
            "modalmotion: there is no C compiler and no zig to compile the library.\n"
            f"Install cc, gcc or clang, or, with network: pip install {ZIG}"
        )
    else:
        command = [sys.executable, "-m", "ziglang", "cc", "-target", made.zig, *made.flags]
    output.parent.mkdir(parents=True, exist_ok=True)
    # Renamed when whole: a process that has loaded the old one keeps it.
    with tempfile.TemporaryDirectory(dir=output.parent) as folder:
        part = Path(folder, output.name)
        chosen = sources() if target is None else sources(TARGETS[target].sources)
        names = [str(source.relative_to(ROOT)) for source in chosen]
        # The decoder of a page changes with its own sources alone.
        stated = [] if target == "wasm32" else [f'-DMM_SOURCES="{digest()}"']
        command += [*FLAGS, *stated, "-o", str(part), *names]
        if subprocess.run(command, cwd=ROOT, check=False).returncode:
            raise SystemExit(f"modalmotion: {command[0]} could not compile the library, see above.")
        part.chmod(0o644)
        part.replace(output)


def suffix(target: str | None) -> str:
    """Suffix of a library."""
    made = TARGETS.get(target or this_machine())
    return ".so" if made is None else made.suffix


def compile_in_place() -> None:
    """Compile for this machine into the checkout."""
    compile_library(ROOT / "core" / "modalmotion" / FOLDER / f"modalmotion{suffix(None)}")


def get_build_hook() -> type[Any]:
    """Give the hook of hatchling, which is there only while a wheel is built."""
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface

    class Library(BuildHookInterface):  # type: ignore[type-arg]
        """Compiles the library into wheels, and beside the sources of editable ones."""

        def dependencies(self) -> list[str]:
            is_enough = VARIABLE not in os.environ and system_compiler() is not None
            return [] if is_enough else [ZIG]

        def initialize(self, version: str, build_data: dict[str, Any]) -> None:
            if version == "editable":
                compile_in_place()
                return
            target = os.environ.get(VARIABLE)
            name = f"modalmotion{suffix(target)}"
            self.made = tempfile.TemporaryDirectory()
            compile_library(Path(self.made.name, name), target)
            build_data["force_include"][f"{self.made.name}/{name}"] = f"modalmotion/{FOLDER}/{name}"
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{_platform(target)}"

        def finalize(self, version: str, *_: Any) -> None:
            if version != "editable":
                self.made.cleanup()

    return Library


def _platform(target: str | None) -> str:
    """Tag of the machine that a wheel is for."""
    if target is not None:
        return TARGETS[target].platform
    from packaging.tags import platform_tags

    return next(tag for tag in platform_tags() if not tag.startswith(("manylinux", "musllinux")))


if __name__ == "__main__":
    if len(sys.argv) == 1:
        compile_in_place()
    else:
        compile_library(Path(sys.argv[2]) if len(sys.argv) > 2 else WASM, sys.argv[1])
