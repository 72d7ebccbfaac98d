"""Places of what the kernels of a surface keep in the memory."""

from __future__ import annotations

from typing import Final

from modalmotion.codec.machine.layout import PARAMETERS

VERTICES: Final = PARAMETERS
FACES: Final = PARAMETERS + 1
PERIOD: Final = PARAMETERS + 2
RELATIONS: Final = PARAMETERS + 3
KEEPS_ORDER: Final = PARAMETERS + 4
WALK_ONLY: Final = PARAMETERS + 5
TRIANGLES: Final = PARAMETERS + 6
"""(faces, 3): of vertices for a writer, in the order of writing; nodes while they are coded."""

NODE_OF: Final = PARAMETERS + 7
"""(vertices,): node of each vertex."""

N_MET: Final = PARAMETERS + 8
N_DONE: Final = PARAMETERS + 9
KINDS: Final = PARAMETERS + 10
CODES: Final = PARAMETERS + 11
CORNER: Final = PARAMETERS + 12
FACE: Final = PARAMETERS + 13
"""Three: the corners of the triangle so far."""

FIRST_PIVOT: Final = PARAMETERS + 16
N_PIVOTS: Final = PARAMETERS + 17
PIVOTS: Final = PARAMETERS + 18
AT_ROLE: Final = PARAMETERS + 19
N_AROUND: Final = PARAMETERS + 20
LATEST: Final = PARAMETERS + 21
OLDER: Final = PARAMETERS + 22
NEWER: Final = PARAMETERS + 23
"""Nodes by when they were last a corner: the latest, then a list in both directions."""

EDGES: Final = PARAMETERS + 24
N_EDGES: Final = PARAMETERS + 25
LAST_AHEAD: Final = PARAMETERS + 26
LAST_BEHIND: Final = PARAMETERS + 27
"""Open edges, seven numbers each, and the one opened last of each node."""

RING: Final = PARAMETERS + 28
RINGS: Final = PARAMETERS + 29
"""Where the ring of each node begins in the rings, (vertices + 1,)."""

NUMBER: Final = PARAMETERS + 30
NODES: Final = PARAMETERS + 31
DISTANCE: Final = PARAMETERS + 32
FREE_AT: Final = PARAMETERS + 33
STAMP: Final = PARAMETERS + 34
N_STAMPS: Final = PARAMETERS + 35
QUEUE: Final = PARAMETERS + 36
TRUST: Final = PARAMETERS + 37
RELATED: Final = PARAMETERS + 38
SMALL: Final = PARAMETERS + 39
"""Short lists of one step of the numbering."""

TAG_EDGE: Final = 2
TAG_BESIDE: Final = 3
TAG_RING: Final = 4
TAG_PATH: Final = 5
TAG_PAIR: Final = 6
TAG_TAKEN: Final = 7
TAG_STEPS: Final = 8
"""Kinds of keys of the hash table; answers have 1 in the lowest bit of five, and these more."""

NEXT_BESIDE: Final = PARAMETERS + 40
USED: Final = PARAMETERS + 41
"""Of a writer that chooses the order: the next corner with the same edge, triangles written."""

MET: Final = PARAMETERS + 42
"""(faces, 3): nodes of the triangles in the order of writing."""

SEEN: Final = PARAMETERS + 43
AFTER: Final = PARAMETERS + 44
HAS_AFTER: Final = PARAMETERS + 45
HAS_BEFORE: Final = PARAMETERS + 46
IN_RING: Final = PARAMETERS + 47
PAIRS: Final = PARAMETERS + 48
FIRST_PAIR: Final = PARAMETERS + 49
"""While rings are made: notes on nodes, and the other two corners of the triangles of each."""

AROUND: Final = PARAMETERS + 50
PARENTS: Final = PARAMETERS + 51
WAY: Final = PARAMETERS + 52
"""A search: nodes, places of those that led to them, and one way."""

SLOT: Final = PARAMETERS + 53
PROPOSED: Final = PARAMETERS + 54
SOURCES: Final = PARAMETERS + 55
"""Proposals of one step: of each node, their list, and their sources."""

PATHS: Final = PARAMETERS + 56
STEPS: Final = PARAMETERS + 57
TURNS: Final = PARAMETERS + 58
"""Prefixes of paths, what each context remembers, and the turns of one path."""

BACK: Final = PARAMETERS + 59
ENTERED: Final = PARAMETERS + 60
"""Of each entry of the rings, its node's place in that neighbour's ring; where a search came in."""
