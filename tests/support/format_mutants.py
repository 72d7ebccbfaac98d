"""Damaged files: bytes changed, pieces cut, doubled or swapped, numbers turned to others."""

from __future__ import annotations

import base64
import copy
import io
import json
import random
import re
import zipfile
from collections.abc import Iterator
from typing import Any, Final

from format_samples import zipped
from image_files import repacked

from modalmotion.formats.glb import File
from modalmotion.formats.glb_writing import write_container
from modalmotion.hdf5.sealed import SEAL_LENGTH, seal
from modalmotion.limits import NO_LIMITS

_NUMBERS: Final = (
    b"0 -1 1 2 12 13 255 256 65536 2147483648 4294967295 1000000000 99999999999999999999 1e999 "
    b"nan inf -0 [] {} null true .. / \xff\xff\xff\xff \xc3\xa9"
)
_WORDS: Final = (*_NUMBERS.split(b" "), b"", b"\n", b"\0\0\0\0", b"1" * 400)

# What a length in binary may be said to be.
_LENGTHS: Final = (0, 1, 255, 2**15, 2**16 - 1, 10**8, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63)

# Heads of arrays in base64.
_HEADS: Final = re.compile(rb"(?<=>)\s*([A-Za-z0-9+/=]{32})")

PACKED: Final = (" gz", " gzip", " zlib")
"""Ends of the names of files that are packed behind a head."""

_VALUES: Final[tuple[Any, ...]] = (
    *(None, True, False, -1, 0, 1, 2, 3, 12, 255, 2**31, 2**62, 2**70, 0.5, -0.5, 1e308, 1.0),
    *("", "x", "VEC3", "SCALAR", "STEP", "CUBICSPLINE", "rotation", "weights", "http://x/y.bin"),
    *([], {}, [0], [[1]], {"a": 1}, [0, 0, 0, 0], [1, "a", None], [1e300] * 16, [0.0] * 3),
    *(5120, 5121, 5123, 5125, 5126),
)


def mutant(name: str, data: bytes, number: int) -> bytes:
    """Damage a file, the same way for the same number.

    Where a format guards its content by checksums or lengths, half of the mutants are damaged
    behind those guards.
    """
    chance = random.Random(f"{name} {number}")  # noqa: S311 - reproducible damage
    if chance.random() < 0.5:
        if name.endswith(" zip"):
            return _in_member(data, chance)
        if name.endswith(PACKED):
            return repacked(name, data, lambda plain: _damaged(plain, chance))
        if name.startswith("vtp Binary"):
            found = chance.choice(list(_HEADS.finditer(data)))
            head = base64.b64encode(_damaged(base64.b64decode(found[1]), chance))
            return data[: found.start(1)] + head + data[found.end(1) :]
        if name == "glb":
            return _in_document(data, chance)
        if name == "hdf5":
            return seal(_damaged(data[:-SEAL_LENGTH], chance))
        if name == "vtkhdf":
            return data[:48] + _damaged(data[48:], chance)
    return _damaged(data, chance)


def _damaged(data: bytes, chance: random.Random) -> bytes:
    damaged = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        # Half of the damage near the beginning, where headers are.
        near = chance.random() < 0.5
        at = chance.randrange(min(len(damaged), 400) + 1 if near else len(damaged) + 1)
        end = min(at + chance.randrange(1, 40), len(damaged))
        match chance.randrange(7):
            case 0:
                damaged[at : at + 1] = bytes([chance.randrange(256)])
            case 1 if at < len(damaged):
                damaged[at] ^= 1 << chance.randrange(8)
            case 2:
                del damaged[at : end if chance.random() < 0.7 else len(damaged)]
            case 3:
                damaged[at:at] = damaged[chance.randrange(len(damaged) + 1) :][: end - at]
            case 4:
                damaged[at : at + chance.randrange(6)] = chance.choice(_WORDS)
            case 5:
                size, order = chance.choice((2, 4, 8)), chance.choice(("little", "big"))
                number = chance.choice(_LENGTHS) % 256**size
                damaged[at : at + size] = number.to_bytes(size, order)
            case _:
                numbers = list(re.finditer(rb"\d+", bytes(damaged[:4000])))
                if numbers:
                    found = chance.choice(numbers)
                    damaged[found.start() : found.end()] = chance.choice(_WORDS)
    return bytes(damaged)


def _in_member(data: bytes, chance: random.Random) -> bytes:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = chance.choice(sorted(members))
    return zipped(members | {name: _damaged(members[name], chance)}, zipfile.ZIP_STORED)


def _in_document(data: bytes, chance: random.Random) -> bytes:
    container = File(data, NO_LIMITS)
    document = json.loads(json.dumps(container.document))
    for _ in range(chance.randint(1, 3)):
        *above, last = chance.choice([path for path in _paths(document) if path])
        place = document
        for key in above:
            place = place[key]
        if chance.random() < 0.2:
            del place[last]
        else:
            place[last] = copy.deepcopy(chance.choice(_VALUES))
    binary = bytearray(container.binary)
    if chance.random() < 0.3:
        binary[chance.randrange(len(binary))] = chance.randrange(256)
    return write_container(document, bytes(binary))


def _paths(value: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield above
    inside = value.items() if isinstance(value, dict) else ()
    for key, below in enumerate(value) if isinstance(value, list) else inside:
        yield from _paths(below, (*above, key))
