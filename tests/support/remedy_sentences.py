"""Remedies as they stand in the sources."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache

from project import ROOT

SOURCES = (ROOT / "core" / "modalmotion", ROOT / "service" / "modalmotion_service")


@cache
def _nodes() -> tuple[tuple[str, ast.AST], ...]:
    return tuple(
        (str(path.relative_to(source.parent)), node)
        for source in SOURCES
        for path in sorted(source.rglob("*.py"))
        # The page of the interface shows commands of curl, and styles.
        if "documentation" not in path.parts
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.keyword | ast.Constant | ast.JoinedStr)
    )


def remedies() -> Iterator[tuple[str, str]]:
    """Yield the place and the text of each remedy, a gap where a value stands."""
    for place, node in _nodes():
        if isinstance(node, ast.keyword) and node.arg == "remedy":
            for text in texts(node.value):
                yield place, text


def sentences() -> Iterator[tuple[str, str]]:
    """Yield the place and each text that may name an option, a command or a setting of ours."""
    yield from remedies()
    for place, node in _nodes():
        if isinstance(node, ast.Constant | ast.JoinedStr):
            for text in texts(node):
                if "--" in text and " " in text:
                    yield place, text


def texts(node: ast.expr) -> list[str]:
    """Texts that an expression may be: both of a choice, a gap for what is computed."""
    if isinstance(node, ast.Constant):
        return [node.value] if isinstance(node.value, str) else []
    if isinstance(node, ast.JoinedStr):
        return [
            "".join(v.value if isinstance(v, ast.Constant) else "…" for v in node.values)  # type: ignore[misc]
        ]
    if isinstance(node, ast.IfExp):
        return [*texts(node.body), *texts(node.orelse)]
    if isinstance(node, ast.BinOp):
        return [a + b for a in texts(node.left) or ["…"] for b in texts(node.right) or ["…"]]
    return []


def named_in(text: str, options: set[str]) -> bool:
    """Whether a remedy names an option: --such, `such`, such_a_one, SUCH_A_ONE."""
    if re.search(r"--[a-z]|`|MODALMOTION_", text):
        return True
    return any(word in options for word in re.findall(r"\b[a-z]+(?:_[a-z]+)+\b", text))
