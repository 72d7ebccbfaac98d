"""How much of a module there is to read."""

from __future__ import annotations

import ast
import re
import tokenize
from pathlib import Path

_C_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)


def count(path: Path) -> tuple[int, int]:
    """Count code lines (no blank, comment, docstring or import lines) and import lines."""
    if path.suffix != ".py":
        return _count_c(path), 0
    aside, imports, code = set[int](), set[int](), set[int]()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.stmt):
            span = range(node.lineno, (node.end_lineno or node.lineno) + 1)
            if isinstance(node, ast.Import | ast.ImportFrom):
                imports.update(span)
            elif isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str):
                aside.update(span)
    with tokenize.open(path) as file:
        for token in tokenize.generate_tokens(file.readline):
            if token.string.strip() and token.type != tokenize.COMMENT:
                code.update(range(token.start[0], token.end[0] + 1))
    return len(code - aside - imports), len(imports)


def _count_c(path: Path) -> int:
    """Count the code lines of a file of C: no blank, comment or include lines."""
    text = _C_COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), path.read_text())
    lines = map(str.strip, text.splitlines())
    return sum(bool(line) and not line.startswith("#include") for line in lines)


def constants(path: Path) -> int:
    """Count named constants at the top of a module of Python."""
    if path.suffix != ".py":
        return 0
    body = ast.parse(path.read_text()).body
    targets: list[ast.expr] = [node.target for node in body if isinstance(node, ast.AnnAssign)]
    targets += [t for node in body if isinstance(node, ast.Assign) for t in node.targets]
    return sum(isinstance(each, ast.Name) and each.id.strip("_").isupper() for each in targets)
