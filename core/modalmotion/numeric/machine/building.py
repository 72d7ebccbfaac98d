"""Compile kernels to an image. This needs numba; running them does not."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import ModalMotionError, ParameterError, needs_extra
from modalmotion.numeric.machine.image import folders, is_served, pack

_TRIPLE: Final = "x86_64-unknown-linux-gnu"
# Reference counts of arrays that nobody counts: never called, but named.
_NOBODY: Final = "define void @NRT_MemInfo_call_dtor(ptr %0) {\n  ret void\n}\n"
_PC32: Final = 2
_PLT32: Final = 4
_ALLOCATED: Final = 2
_PROGRAM: Final = 1
_SYMBOLS: Final = 2
_RELOCATIONS: Final = 4


Entries = Mapping[Callable[..., int], str]
"""Functions, and a letter for each argument of theirs.

i and d are a whole number and a number; the others addresses: B of uint8, U of uint32, L of int64,
F of float32, D of float64.
"""

_POINTERS: Final = {"B": "uint8", "U": "uint32", "L": "int64", "F": "float32", "D": "float64"}
_NUMBERS: Final = {"i": "int64", "d": "float64"}


def keep_image(name: str, entries: Callable[[], Entries], folder: Path | None = None) -> Path:
    """Compile, and keep the image.

    Parameters
    ----------
    name : str
        Of the file.
    entries : callable
        Gives the entries; called only where they are compiled.
    folder : Path, optional
        Where; by default the first of `folders` that can be written to.

    Returns
    -------
    Path
        Of the image, which is not made again if it is there.

    Raises
    ------
    ParameterError
        If this machine is not served, or no folder can be written to.
    MissingExtraError
        If numba is not installed.
    """
    if not is_served():
        raise ParameterError(
            "The kernels are compiled for x86-64 on Linux and macOS only.",
            remedy="Nothing needs to be done: the pure form answers, with the same bytes.",
        )
    data: bytes | None = None
    for place in [folder] if folder is not None else folders():
        path = place / name
        if path.exists():
            return path
        try:
            place.mkdir(parents=True, exist_ok=True)
            partial = path.with_suffix(f".{id(path)}.part")
            partial.touch()
        except OSError:
            continue
        try:
            data = data or make_image(entries)
            partial.write_bytes(data)
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)
        return path
    raise ParameterError(
        "No folder for compiled code can be written to.",
        remedy="Set MODALMOTION_KERNELS to a folder that can.",
    )


def make_image(entries: Callable[[], Entries]) -> bytes:
    """Compile all entries and link them."""
    with needs_extra("codec"):
        import_module("numba")
    return pack(*_link(*_object(entries())))


def _object(entries: Entries) -> tuple[bytes, dict[str, str]]:
    """Compile all entries: an object file, and the name of each in it."""
    numba = import_module("numba")
    binding = import_module("llvmlite.binding")
    options = import_module("modalmotion.numeric.machine.compiled").OPTIONS
    types: Any = numba.types
    kinds = {letter: types.CPointer(getattr(types, kind)) for letter, kind in _POINTERS.items()}
    kinds |= {letter: getattr(types, kind) for letter, kind in _NUMBERS.items()}
    module = binding.parse_assembly(_NOBODY)
    names = {}
    for entry, letters in entries.items():
        signature = types.int64(*(kinds[letter] for letter in letters))
        compiled = numba.njit(signature, **options)(entry)
        overload = compiled.overloads[compiled.signatures[0]]
        names[entry.__name__] = overload.fndesc.llvm_func_name
        module.link_in(binding.parse_assembly(overload.library.get_llvm_str()))
    module.triple = _TRIPLE
    for function in module.functions:
        if not function.is_declaration and function.name not in names.values():
            function.linkage = "internal"
    # Any processor of this kind: the kernels gain nothing from the features of later ones.
    machine = binding.Target.from_triple(_TRIPLE).create_target_machine(
        opt=3, reloc="pic", codemodel="small"
    )
    return machine.emit_object(module), names


def _link(data: bytes, names: dict[str, str]) -> tuple[bytes, dict[str, int]]:
    """Lay the sections of an object file out and resolve what they know of each other.

    All distances are known once the sections have their places, and nothing else is named.
    """
    (table,) = struct.unpack_from("<Q", data, 40)
    size, count, _ = struct.unpack_from("<3H", data, 58)
    fields = ("name", "type", "flags", "address", "offset", "size", "link", "info", "align", "each")
    sections: list[dict[str, int]] = [
        dict(zip(fields, struct.unpack_from("<IIQQQQIIQQ", data, table + i * size), strict=True))
        for i in range(count)
    ]
    code = bytearray()
    place: dict[int, int] = {}
    for number, section in enumerate(sections):
        if section["type"] == _PROGRAM and section["flags"] & _ALLOCATED:
            code += bytes(-len(code) % max(16, section["align"]))
            place[number] = len(code)
            code += data[section["offset"] : section["offset"] + section["size"]]
    symbols: dict[int, list[tuple[str, int | None]]] = defaultdict(list)
    found: dict[str, int] = {}
    for number, section in enumerate(sections):
        if section["type"] != _SYMBOLS:
            continue
        text = sections[section["link"]]["offset"]
        for at in range(section["offset"], section["offset"] + section["size"], section["each"]):
            start, _, _, home, value, _ = struct.unpack_from("<IBBHQQ", data, at)
            end = data.index(b"\0", text + start)
            name = data[text + start : end].decode()
            where = place[home] + value if home in place else None
            symbols[number].append((name, where))
            if where is not None:
                found[name] = where
    for section in sections:
        if section["type"] == _RELOCATIONS and section["info"] in place:
            _resolve(code, data, section, place[section["info"]], symbols[section["link"]])
    return bytes(code), {entry: found[name] for entry, name in names.items()}


def _resolve(
    code: bytearray,
    data: bytes,
    section: dict[str, int],
    base: int,
    symbols: list[tuple[str, int | None]],
) -> None:
    for at in range(section["offset"], section["offset"] + section["size"], section["each"]):
        offset, info, addend = struct.unpack_from("<QQq", data, at)
        name, target = symbols[info >> 32]
        if info & 0xFFFFFFFF not in (_PC32, _PLT32) or target is None:
            raise ModalMotionError(
                f"The compiled code refers to {name or 'an address'} outside of itself.",
                remedy="Use a version of numba that constraints.txt names.",
            )
        struct.pack_into("<i", code, base + offset, target + addend - (base + offset))
