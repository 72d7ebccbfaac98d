"""Counts packages, layers, cycles and imports of higher layers, from the sources alone.

A package is one directly under a root, with everything inside it; a single module at the root is a
node of its own. Every import counts, inside functions and for types too, and every module of the
root that a string names. The root's own `__init__`, which lists the public names, is the one
exception: it is above everything::

    python tools/packages.py
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

PROJECT = Path(__file__).resolve().parents[1]
ROOTS = {
    "modalmotion": PROJECT / "core" / "modalmotion",
    "modalmotion_service": PROJECT / "service" / "modalmotion_service",
}

Graph = dict[str, set[str]]


def modules_of(root: str, folder: Path) -> dict[str, Path]:
    """Return the modules below a folder by their dotted names."""
    found = {}
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        found[".".join([root, *parts])] = path
    return found


def named_in(text: str, modules: Mapping[str, Path]) -> Iterator[str]:
    """Yield the modules that a text names in full."""
    for name in re.findall(r"\bmodalmotion\w*(?:\.\w+)+", text):
        while name and name not in modules:
            name = name.rpartition(".")[0]
        if "." in name:
            yield name


_NAMING: Final = (ast.Import, ast.ImportFrom, ast.Constant, ast.Attribute, ast.arg)


@cache
def naming_nodes(text: str) -> tuple[ast.AST, ...]:
    """Return the nodes of a source that may name a module; each source is parsed once."""
    found: list[ast.AST] = []
    nodes: list[ast.AST] = [ast.parse(text)]
    for node in nodes:
        if isinstance(node, _NAMING):
            found.append(node)
        for name in node._fields:
            inner = getattr(node, name)
            if isinstance(inner, list):
                nodes += [one for one in inner if isinstance(one, ast.AST)]
            # Nodes without fields, such as operators, name nothing.
            elif isinstance(inner, ast.AST) and inner._fields:
                nodes.append(inner)
    return tuple(found)


def imports_of(path: Path, modules: Mapping[str, Path]) -> set[str]:
    """Return the modules of the same root that a file imports or names."""
    found: set[str] = set()
    for node in naming_nodes(path.read_text()):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found.add(inner if inner in modules else node.module)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.update(named_in(node.value, modules))
    return found & modules.keys()


def module_graph(root: str, folder: Path) -> Graph:
    """Return what each module imports; the root's own `__init__` is left out."""
    modules = modules_of(root, folder)
    del modules[root]
    return {name: imports_of(path, modules) - {name} for name, path in modules.items()}


def package_of(module: str) -> str:
    """Return the package of a module: the first name below its root."""
    return module.split(".")[1]


def package_graph(graph: Graph) -> Graph:
    """Return the other packages that each package imports."""
    nodes: Graph = {package_of(name): set() for name in graph}
    for name, imported in graph.items():
        nodes[package_of(name)] |= {package_of(other) for other in imported} - {package_of(name)}
    return nodes


def cycles(graph: Graph) -> list[list[str]]:
    """Return the groups of nodes that reach one another (Tarjan's strong components)."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        order[node] = low[node] = len(order)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in order:
                visit(other)
            if other in stack:
                low[node] = min(low[node], low[other])
        if low[node] == order[node]:
            place = stack.index(node)
            group = stack[place:]
            del stack[place:]
            if len(group) > 1:
                found.append(sorted(group))

    for node in sorted(graph):
        if node not in order:
            visit(node)
    return found


def levels(graph: Graph) -> dict[str, int]:
    """Return the level of each package: one above the highest that it imports. No cycles."""
    known: dict[str, int] = {}

    def level(node: str) -> int:
        if node not in known:
            known[node] = 1 + max((level(other) for other in graph[node]), default=-1)
        return known[node]

    for node in graph:
        level(node)
    return known


def layers(root: str) -> list[list[str]]:
    """Return the layers of import-linter, the highest first."""
    settings = tomllib.loads((PROJECT / "pyproject.toml").read_text())
    for contract in settings["tool"]["importlinter"]["contracts"]:
        if contract["type"] == "layers" and contract["containers"] == [root]:
            return [re.split(r"\s*[|:]\s*", layer) for layer in contract["layers"]]
    return []


def upward_imports(graph: Graph, of_layers: list[list[str]]) -> list[str]:
    """Return imports of higher or equal layers; a package of no layer counts too."""
    height = {node: -place for place, layer in enumerate(of_layers) for node in layer}
    return [
        f"{node} -> {other}"
        for node, imported in sorted(graph.items())
        for other in sorted(imported)
        if node != "__main__"
        and not height.get(node, -sys.maxsize) > height.get(other, sys.maxsize)
    ]


@dataclass(frozen=True)
class Survey:
    """Counts of one root."""

    modules: Graph
    nodes: Graph
    packages: list[str]
    single: list[str]
    module_cycles: list[list[str]]
    package_cycles: list[list[str]]
    upward_imports: list[str]


def survey(root: str, folder: Path) -> Survey:
    """Count the packages below one root."""
    modules = module_graph(root, folder)
    nodes = package_graph(modules)
    packages = [node for node in sorted(nodes) if (folder / node).is_dir()]
    return Survey(
        modules=modules,
        nodes=nodes,
        packages=packages,
        single=[node for node in sorted(nodes) if node not in packages and node != "__main__"],
        module_cycles=cycles(modules),
        package_cycles=cycles(nodes),
        upward_imports=upward_imports(nodes, layers(root)),
    )


def main() -> None:
    """Print the counts of each root."""
    for root, folder in ROOTS.items():
        counted = survey(root, folder)
        print(
            f"{root}: {len(counted.modules)} modules in {len(counted.packages)} packages, "
            f"{len(counted.single)} single ({', '.join(counted.single)}); cycles: "
            f"{len(counted.package_cycles)} of packages, {len(counted.module_cycles)} of modules; "
            f"upward imports: {len(counted.upward_imports)}"
        )
        for cycle in [*counted.package_cycles, *counted.module_cycles]:
            print("  cycle:", " ".join(cycle))
        for one in counted.upward_imports:
            print("  up:", one)
        if not counted.package_cycles:
            of_level: dict[int, list[str]] = {}
            for node, level in levels(counted.nodes).items():
                of_level.setdefault(level, []).append(node)
            for level in sorted(of_level, reverse=True):
                print(f"  {level:2}  {' '.join(sorted(of_level[level]))}")


if __name__ == "__main__":
    main()
