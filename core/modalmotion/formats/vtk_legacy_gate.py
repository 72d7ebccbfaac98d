"""The gate before VTK's reader of legacy .vtk files: sizes and names, by the words before them.

VTK reads words, not lines, in any case; allocates the sizes that it reads; writes words of any
length into 256 bytes; and follows the lengths of polygons wherever they lead.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.limits import ReadLimits

_malformed: Final = partial(
    MalformedFileError, remedy="Save the frame again as a polygonal surface (vtkPolyData)."
)

_MOST_ARRAYS: Final = 500
_MOST_COLUMNS: Final = 16
_LONGEST_WORD: Final = 250
_BLOCK: Final = 1 << 24
# Letters of a corner of a polygon, with the blanks around it.
_WIDEST_NUMBER: Final = 24

_POLYGONS: Final = (b"polygons", b"cells")
_CELLS: Final = (*_POLYGONS, b"vertices", b"lines", b"triangle_strips")
# Words before a size, by the number of words between.
_TABLE: Final = b"lookup_table"
_SIZED: Final = {
    **dict.fromkeys((b"point_data", b"cell_data", b"cell_types", b"information", b"data"), 0),
    **dict.fromkeys((b"field", _TABLE), 1),
}
# Words before a number of columns, likewise.
_WIDE: Final = {b"scalars": 2, b"color_scalars": 1, b"texture_coordinates": 1}
_INTEGERS: Final = (b"char", b"short", b"int", b"long", b"long_long")
_TYPES: Final = (
    *(b"bit", b"float", b"double", b"string", b"utf8_string", b"variant", b"vtkidtype"),
    *(sign + kind for sign in (b"", b"unsigned_", b"signed_") for kind in _INTEGERS),
    *(sign + b"int%d" % bits for sign in (b"vtktype", b"vtktypeu") for bits in (8, 16, 32, 64)),
)
_NEXT: Final = re.compile(rb"\s+(\S+)")


def require_plain_legacy(data: bytes, limits: ReadLimits) -> None:
    """Refuse a legacy .vtk file that is costly or dangerous to read.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits

    Raises
    ------
    MalformedFileError
        If its sizes are not numbers, are more than its bytes can contain, or contradict its
        polygons.
    LimitError
        If it declares more than `limits` accept, or more arrays than a surface has.
    """
    # The first two lines are free text, though not to a reader of words.
    start = data.find(b"\n", data.find(b"\n") + 1) + 1
    text = b"\n" + data[start:].lower()
    is_binary = text.split(None, 1)[:1] == [b"binary"]
    if not is_binary:
        _require_short_words(text)
    declared = _Declared(len(data))
    for end in _ends(text, b"points"):
        n = declared.size(text, end, 0)
        limits.require("vertices", n)
        declared.hold(3 * n)
    for word in _CELLS:
        for end in _ends(text, word):
            n, n_numbers = declared.size(text, end, 0), declared.size(text, end, 1)
            if word in _POLYGONS:
                limits.require("faces", n)
            declared.hold(n + n_numbers)
            _require_cells(text, data, start - 1, end, n, n_numbers, is_binary=is_binary)
    for word, n_between in _SIZED.items():
        for end in _ends(text, word):
            if word == _TABLE and b"scalars" in _words_before(text, end - len(word), 4)[:2]:
                # SCALARS name type [columns] names its table: the numbers behind it are data.
                continue
            declared.hold(declared.size(text, end, n_between))
    for word, n_between in _WIDE.items():
        for end in _ends(text, word):
            if declared.size(text, end, n_between, default=1) > _MOST_COLUMNS:
                raise _malformed(
                    f"The .vtk file has data of more than {_MOST_COLUMNS} numbers per vertex."
                )
    for word in _TYPES:
        for end in _ends(text, word):
            declared.array(_words_before(text, end - len(word), 3))


class _Declared:
    """Adds up what a file declares."""

    def __init__(self, n_bytes: int) -> None:
        self.n_bytes = n_bytes
        self.n_values = self.n_arrays = 0

    def hold(self, n_values: int) -> None:
        self.n_values += n_values
        self.n_arrays += 1
        if self.n_values > self.n_bytes:
            raise _malformed(
                f"The .vtk file declares {self.n_values} numbers, more than its {self.n_bytes} "
                "bytes can contain."
            )
        if self.n_arrays > _MOST_ARRAYS:
            raise LimitError(
                f"The .vtk file contains more than {_MOST_ARRAYS} arrays.",
                remedy="Save the surface alone, without its arrays of data.",
                limit="vtk_arrays",
                details={"most": _MOST_ARRAYS},
            )

    def array(self, before: list[bytes]) -> None:
        """Count an array whose type follows these words: name, columns, rows in a field."""
        shape = [_number(word) for word in before[-2:] if word[-1:].isdigit()]
        is_of_field = len(shape) == 2 and None not in shape
        # Before a name may be the bytes of other data, of any length.
        if any(len(word) > _LONGEST_WORD for word in before[0 if is_of_field else -1 :]):
            raise _long_word()
        self.hold((shape[0] or 0) * (shape[1] or 0) if is_of_field else 0)

    def size(self, text: bytes, at: int, n_between: int, default: int = 0) -> int:
        """Size behind some words; `default` where there is no number, as in free text."""
        for k in range(n_between + 1):
            match = _NEXT.match(text, at)
            if match is None:
                return default
            word, at = match[1], match.end()
            # The last one is read as a number, however long.
            if len(word) > _LONGEST_WORD and k < n_between:
                raise _long_word()
        number = _number(word)
        return default if number is None else number


def _number(word: bytes) -> int | None:
    digits = word.lstrip(b"+-")
    # VTK reads as far as it goes: 12x is 12.
    match = re.match(rb"\d+", digits)
    if match is None:
        return None
    if len(match[0]) > 18 or b"-" in word[:1]:
        raise _malformed(f"The .vtk file declares the size {word[:20].decode('ascii', 'replace')}.")
    return int(match[0])


def _ends(text: bytes, word: bytes) -> Iterator[int]:
    """Places behind a word that stands by itself."""
    at = text.find(word)
    while at >= 0:
        end = at + len(word)
        if text[at - 1 : at].isspace() and text[end : end + 1].isspace():
            yield end
        at = text.find(word, end)


def _words_before(text: bytes, at: int, n: int) -> list[bytes]:
    reach = 1 << 6
    while len(words := text[max(0, at - reach) : at].split()) <= n and reach < at:
        reach *= 2
    return words[-n:]


def _require_short_words(text: bytes) -> None:
    last = -1
    for start in range(0, len(text), _BLOCK):
        block = np.frombuffer(text, np.uint8, min(_BLOCK, len(text) - start), start)
        blanks = np.flatnonzero((block == 32) | ((block >= 9) & (block <= 13))) + start
        edges = np.concatenate([[last], blanks, [start + len(block)]])
        if np.diff(edges).max() > _LONGEST_WORD:
            raise _long_word()
        last = int(edges[-2])


def _require_cells(
    text: bytes, data: bytes, shift: int, at: int, n: int, n_numbers: int, *, is_binary: bool
) -> None:
    """Refuse polygons whose lengths do not add up; VTK reads on behind the last one."""
    for _ in range(2):
        match = _NEXT.match(text, at)
        at = len(text) if match is None else match.end()
    following = _NEXT.match(text, at)
    if following is None or (not is_binary and following[1] == b"offsets"):
        return
    numbers: NDArray[np.int64]
    if is_binary:
        # To the end of the line, then numbers of 32 bits.
        begin = data.find(b"\n", at + shift) + 1
        if data[begin : begin + 7].lower() == b"offsets":
            return
        room = min(n_numbers, max(0, len(data) - begin) // 4)
        numbers = np.frombuffer(data, ">i4", room, begin).astype(np.int64)
    else:
        # Another word in the list is an error, and a list too short is none: both are found below.
        numbers = np.zeros(0, np.int64)
        with warnings.catch_warnings(), suppress(ValueError):
            warnings.simplefilter("ignore", DeprecationWarning)
            words = text[at : at + _WIDEST_NUMBER * n_numbers]
            numbers = np.fromstring(words, np.int64, n_numbers, sep=" ")
    if len(numbers) == 4 * n == n_numbers and (numbers[::4] == 3).all():
        return
    place, listed = 0, numbers.tolist()
    for _ in range(n):
        if place >= len(listed) or not 0 <= listed[place] <= len(listed) - place - 1:
            raise _malformed("The .vtk file's polygons do not add up to its list of corners.")
        place += listed[place] + 1
    if place != n_numbers:
        raise _malformed("The .vtk file's polygons do not add up to its list of corners.")


def _long_word() -> MalformedFileError:
    return _malformed(f"The .vtk file contains a word of more than {_LONGEST_WORD} letters.")
