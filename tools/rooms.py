"""Counts rooms, floors, circles and arrows that point up, from the sources alone.

A room is a package directly under a root, with everything inside it; a module that lies loose at
the root is a node of its own. Every import counts, inside functions and for types too, and every
module of the root that a string names. The root's own `__init__`, which lists the public names,
is the one exception: it stands above everything::

    python tools/rooms.py
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
    """Give the modules below a folder by their dotted names."""
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


_TELLING: Final = (ast.Import, ast.ImportFrom, ast.Constant, ast.Attribute, ast.arg)


@cache
def telling_nodes(text: str) -> tuple[ast.AST, ...]:
    """Give the nodes of a source that may name a module; each source is walked once."""
    found: list[ast.AST] = []
    nodes: list[ast.AST] = [ast.parse(text)]
    for node in nodes:
        if isinstance(node, _TELLING):
            found.append(node)
        for name in node._fields:
            inner = getattr(node, name)
            if isinstance(inner, list):
                nodes += [one for one in inner if isinstance(one, ast.AST)]
            # What has no fields, such as an operator, names nothing.
            elif isinstance(inner, ast.AST) and inner._fields:
                nodes.append(inner)
    return tuple(found)


def imports_of(path: Path, modules: Mapping[str, Path]) -> set[str]:
    """Give the modules of the same root that a file imports or names."""
    found: set[str] = set()
    for node in telling_nodes(path.read_text()):
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
    """Give what each module imports; the root's own `__init__` is left out."""
    modules = modules_of(root, folder)
    del modules[root]
    return {name: imports_of(path, modules) - {name} for name, path in modules.items()}


def room_of(module: str) -> str:
    """Give the room of a module: the first name below its root."""
    return module.split(".")[1]


def room_graph(graph: Graph) -> Graph:
    """Give what each room imports of other rooms."""
    rooms: Graph = {room_of(name): set() for name in graph}
    for name, imported in graph.items():
        rooms[room_of(name)] |= {room_of(other) for other in imported} - {room_of(name)}
    return rooms


def circles(graph: Graph) -> list[list[str]]:
    """Give the groups of nodes that reach one another (Tarjan's strong components)."""
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


def floors(graph: Graph) -> dict[str, int]:
    """Give each room's floor: one above the highest of what it imports. Circles must be none."""
    known: dict[str, int] = {}

    def floor(node: str) -> int:
        if node not in known:
            known[node] = 1 + max((floor(other) for other in graph[node]), default=-1)
        return known[node]

    for node in graph:
        floor(node)
    return known


def layers(root: str) -> list[list[str]]:
    """Give the layers that import-linter holds, the highest first."""
    settings = tomllib.loads((PROJECT / "pyproject.toml").read_text())
    for contract in settings["tool"]["importlinter"]["contracts"]:
        if contract["type"] == "layers" and contract["containers"] == [root]:
            return [re.split(r"\s*[|:]\s*", layer) for layer in contract["layers"]]
    return []


def arrows_up(graph: Graph, of_layers: list[list[str]]) -> list[str]:
    """Give the imports that point up, or aside, in the layers; a room of no layer counts too."""
    height = {room: -place for place, rooms in enumerate(of_layers) for room in rooms}
    return [
        f"{room} -> {other}"
        for room, imported in sorted(graph.items())
        for other in sorted(imported)
        if room != "__main__"
        and not height.get(room, -sys.maxsize) > height.get(other, sys.maxsize)
    ]


@dataclass(frozen=True)
class House:
    """What is counted of one root."""

    modules: Graph
    rooms: Graph
    packages: list[str]
    loose: list[str]
    module_circles: list[list[str]]
    room_circles: list[list[str]]
    arrows_up: list[str]


def survey(root: str, folder: Path) -> House:
    """Count the rooms below one root."""
    modules = module_graph(root, folder)
    rooms = room_graph(modules)
    packages = [room for room in sorted(rooms) if (folder / room).is_dir()]
    return House(
        modules=modules,
        rooms=rooms,
        packages=packages,
        loose=[room for room in sorted(rooms) if room not in packages and room != "__main__"],
        module_circles=circles(modules),
        room_circles=circles(rooms),
        arrows_up=arrows_up(rooms, layers(root)),
    )


def main() -> None:
    """Print what is counted of each root."""
    for root, folder in ROOTS.items():
        house = survey(root, folder)
        print(
            f"{root}: {len(house.modules)} modules in {len(house.packages)} rooms, "
            f"{len(house.loose)} loose ({', '.join(house.loose)}); circles: "
            f"{len(house.room_circles)} of rooms, {len(house.module_circles)} of modules; "
            f"arrows up: {len(house.arrows_up)}"
        )
        for circle in [*house.room_circles, *house.module_circles]:
            print("  circle:", " ".join(circle))
        for arrow in house.arrows_up:
            print("  up:", arrow)
        if not house.room_circles:
            of_floor: dict[int, list[str]] = {}
            for room, floor in floors(house.rooms).items():
                of_floor.setdefault(floor, []).append(room)
            for floor in sorted(of_floor, reverse=True):
                print(f"  {floor:2}  {' '.join(sorted(of_floor[floor]))}")


if __name__ == "__main__":
    main()
