"""How values are shown: in one line, in tables, numbers in words; and types of arrays."""

import csv
import io
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sized
from dataclasses import Field, is_dataclass
from enum import Enum
from operator import attrgetter
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]
Floats: TypeAlias = NDArray[np.float64]
Singles: TypeAlias = NDArray[np.float32]
FloatArray: TypeAlias = Singles | Floats
Complexes: TypeAlias = NDArray[np.complex128]
Ints: TypeAlias = NDArray[np.int64]
Bools: TypeAlias = NDArray[np.bool_]
Bytes: TypeAlias = NDArray[np.uint8]

T = TypeVar("T")

LONGEST_LINE: Final = 120
# Of one attribute; a longer one is shown by its type and size, a text by its start.
_LONGEST: Final = 40
_START: Final = 12
# Joiners, which the writing of some languages needs.
_JOINERS: Final = "\u200c\u200d"
# First letters of what spreadsheets run.
_FORMULAS: Final = ("=", "+", "-", "@", "\t", "\n")


def shown(*names: str) -> Callable[[type[T]], type[T]]:
    """Decorate a class whose values are represented by these attributes, in one line.

    The line has at most 120 characters and ends with an ellipsis where that is too few, so the
    essentials come first. Arrays are shown by type and shape, ids by their start.

    Parameters
    ----------
    names : str
        Attributes, a dot reaching into one, a colon before its unit (another attribute, or %); by
        default all fields that a dataclass shows.
    """

    def decorate(kind: type[T]) -> type[T]:
        def represent(value: Any) -> str:
            parts = (_part(value, name) for name in names or _fields(kind))
            line = f"{kind.__name__}({', '.join(parts)})"
            return line if len(line) <= LONGEST_LINE else f"{line[: LONGEST_LINE - 4]}...)"

        kind.__repr__ = represent  # type: ignore[method-assign]
        return kind

    return decorate


def _part(value: object, name: str) -> str:
    """Write an attribute, called by its last name, with its unit where it is known."""
    name, _, unit = name.partition(":")
    held = attrgetter(name)(value)
    if unit and unit != "%":
        unit = attrgetter(unit)(value) or ""
    # What a reader must not take for certain.
    words = probability(float(held)) if name == "probability" else _brief(held)
    text = f"{name.rpartition('.')[2]}={words}"
    return f"{text} {unit}" if unit and held is not None else text


def _fields(kind: type) -> list[str]:
    fields: dict[str, Field[Any]] = getattr(kind, "__dataclass_fields__", {})
    return [name for name, field in fields.items() if field.repr]


def _brief(value: object) -> str:
    kind = type(value)
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{list(value.shape)}"
    if isinstance(value, float | np.floating):
        return f"{value:.4g}"
    if isinstance(value, Enum):
        return repr(value.value)
    if isinstance(value, str):
        return repr(value) if len(value) <= _LONGEST else f"{value[:_START]!r}..."
    if kind.__module__.startswith("modalmotion") and "__str__" in vars(kind):
        return str(value)
    if isinstance(value, tuple) and len(value) <= _START:
        text = f"({', '.join(map(_brief, value))})"
    else:
        text = "" if isinstance(value, bytes) else repr(value)
    if text and len(text) <= _LONGEST and "\n" not in text:
        return text
    return f"{kind.__name__}[{len(value)}]" if isinstance(value, Sized) else f"{kind.__name__}(...)"


def plain(value: Any) -> Any:
    """Return a value as JSON has it: fields by their names, lists, None for what is unknown."""
    if isinstance(value, np.ndarray):
        is_known = value.dtype.kind != "f" or not np.isnan(value).any()
        return value.tolist() if is_known else [plain(one) for one in value.tolist()]
    if is_dataclass(value):
        value = {name: getattr(value, name) for name in value.__dataclass_fields__}
    elif hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(name): plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, Enum):
        return value.value
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and value != value else value


def is_readable(text: str) -> bool:
    """Return whether a text shows all that it contains.

    Control characters do not, nor what turns its direction or has no width; and the sign in place
    of broken UTF-8 stands for what nobody knows.
    """
    return "\ufffd" not in text and not any(
        unicodedata.category(one) in ("Cc", "Cs", "Cf") and one not in _JOINERS for one in text
    )


def csv_text(rows: Iterable[Iterable[object]], line_end: str = "\n") -> str:
    """Write rows as CSV that a spreadsheet takes for text and numbers, and never for formulas.

    Parameters
    ----------
    rows : iterable of rows
    line_end : str

    Returns
    -------
    str
        Texts that a spreadsheet would run have an apostrophe in front (CWE-1236); numbers, in
        words or not, stay as they are.
    """
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator=line_end).writerows([_cell(one) for one in row] for row in rows)
    return text.getvalue()


def _cell(value: object) -> object:
    if value is None or isinstance(value, int | float):
        return value
    # The writer quotes no carriage return, and readers begin a row at one.
    text = str(value).replace("\r", "\n")
    if not text.startswith(_FORMULAS):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


# Significant digits of very small and very large numbers, and where the large ones begin.
_DIGITS: Final = 3
_LARGE: Final = 1e7

# Share of `of`; a smaller number is the rounding of double precision.
_ROUNDING: Final = 1e-12


def numeral(value: float, decimals: int = 3, *, of: float = 0.0) -> str:
    """Write a number with fixed decimals, or with three digits where these would not show it.

    Millimetres look alike this way, and 0.3 mm in metres is 0.000288 and not 0.000.

    Parameters
    ----------
    value : float
    decimals : int
        Unless three digits need more.
    of : float
        Size that the number is a part of: its rounding is shown as zero.
    """
    size = abs(value)
    if size <= _ROUNDING * abs(of):
        return f"{0.0:.{decimals}f}"
    if 10.0 ** (_DIGITS - 1 - decimals) <= size < _LARGE:
        return f"{value:.{decimals}f}"
    return f"{value:#.{_DIGITS}g}"


def with_interval(value: float, low: float, high: float) -> tuple[str, str]:
    """Write a number and its interval, with one decimal, or as many as tell its ends apart.

    Two at most: an interval that is narrower is said to be.

    Examples
    --------
    >>> with_interval(62.14, 60.9, 63.4)
    ('62.1', '60.9 to 63.4')
    >>> with_interval(179.031, 179.011, 179.043)
    ('179.03', '179.01 to 179.04')
    """
    for decimals in (1, 2):
        texts = [f"{x:.{decimals}f}" for x in (value, low, high)]
        if texts[1] != texts[2]:
            return texts[0], f"{texts[1]} to {texts[2]}"
    return f"{value:.2f}", "± less than 0.01"


def probability(value: float) -> str:
    """Write the probability of an answer, never as certain: "0.87", "> 0.99"."""
    return "> 0.99" if value > 0.99 else f"{value:.2f}"


def with_article(noun: str) -> str:
    """Write a noun with its article: a cup, an open curve."""
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def counted(n: int, noun: str, plural: str = "") -> str:
    """Write a count with its noun: 1 frame, 2 frames."""
    return f"{n} {noun if n == 1 else plural or noun + 's'}"
