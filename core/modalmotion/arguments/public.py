"""Public lists of packages: each name once, imported when it is first used."""

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from modalmotion.errors import not_to_be_called

# A formatter puts long names in parentheses, and one home's names may follow one another there.
_FROM: Final = re.compile(r"^    from (modalmotion\.[\w.]+) import (\([^)]*\)|.*)$", re.MULTILINE)
_NAMED: Final = re.compile(r"\b(\w+) as \1\b")


def public_list(
    package: dict[str, Any],
) -> tuple[list[str], Callable[[str], object], Callable[[], list[str]]]:
    """Make `__all__`, `__getattr__` and `__dir__` (PEP 562) of a package.

    Its names and their homes are read from the text that type checkers read: the lines
    `from home import name as name` under `if TYPE_CHECKING`. All imports at once would take most
    of a second, and most programs need few. Packages within are found by their names too.

    Parameters
    ----------
    package : dict
        The package's `globals()`.
    """
    folder = Path(package["__file__"]).parent
    homes = homes_in(folder / "__init__.py")
    names = sorted(homes)
    not_to_be_called(package["__name__"])

    def get(name: str) -> object:
        if name not in homes:
            if (folder / name / "__init__.py").is_file():
                return import_module(f"{package['__name__']}.{name}")
            raise AttributeError(f"module {package['__name__']!r} has no attribute {name!r}")
        from modalmotion.arguments.checking import checked

        value: object = checked(getattr(import_module(homes[name]), name), package["__name__"])
        package[name] = value
        return value

    return names, get, lambda: names


def homes_in(path: Path) -> dict[str, str]:
    """Give the home of each public name that the `__init__.py` of a package lists."""
    lists = _FROM.findall(path.read_text())
    return {name: home for home, names in lists for name in _NAMED.findall(names)}
