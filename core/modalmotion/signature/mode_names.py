"""Plain names of modes and their directions, and a colour and a dash for each."""

from typing import Final

from modalmotion.modes.topologies import (
    CLOSED,
    CLOSED_CURVE,
    CUP,
    CYLINDER,
    OPEN_CURVE,
    PLANE,
    SPHERE,
    TORUS,
    ModeLabel,
    Topology,
)
from modalmotion.representation import counted
from modalmotion.signature.making import ModalSignature, SignatureKind
from modalmotion.template.body_frame import Components

# Distinct for colour-blind readers too (Okabe and Ito, Color Universal Design, 2008).
COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#6A51A3")
"""Of labels, in the order of `mode_tone`."""

DASHES: Final = ((), (7, 2.5), (2, 2), (8, 2, 2, 2), (4, 2), (8, 2, 2, 2, 2, 2))
"""Lengths of lines and gaps, in points: colours are distinguished without seeing them."""


def mode_tone(label: ModeLabel) -> int:
    """Give the number of a label: by the sum of its wavenumbers, then by the later ones.

    A cosine and its sine have one number: (0, 0) 0, (1, 0) 1, (0, 1) 2, (2, 0) 3, (1, 1) 4.
    """
    *before, number = map(abs, label.wavenumbers)
    for p in reversed(before):
        # Cantor's pairing: every pair once.
        total = p + number
        number += total * (total + 1) // 2
    # A wave that runs backwards is three colours away.
    return number + 3 * (min(label.wavenumbers) < 0)


def mode_colour(label: ModeLabel) -> str:
    """Give the colour of a mode, as #rrggbb."""
    return COLOURS[mode_tone(label) % len(COLOURS)]


def mode_dash(label: ModeLabel) -> tuple[float, ...]:
    """Give the dash of a mode: with its colour it is that of no other among 36."""
    tone = mode_tone(label)
    return DASHES[(tone + tone // len(COLOURS)) % len(DASHES)]


def direction_names(signature: ModalSignature) -> tuple[str, ...]:
    """Name the directions of a signature's amplitudes."""
    if signature.kind == SignatureKind.NORMAL_DISPLACEMENT:
        return ("normal",)
    if signature.parameters.components == Components.CARTESIAN:
        return ("x", "y", "z")
    return ("radial", "tangential", "axial")


def mode_name(signature: ModalSignature, label: ModeLabel) -> str:
    """Describe how the surface moves in a mode of a signature: see `plain_name`."""
    along_normal = signature.kind == SignatureKind.NORMAL_DISPLACEMENT
    components = signature.parameters.components
    return plain_name(signature.topology, label, components, along_normal=along_normal)


_Names = dict[tuple[int, ...], str]

# Along x, y and z a contraction is x cos + y sin: one wave around. By radial, tangential and
# axial components the same motion is that of mode (0, 0).
_ROUND: Final[_Names] = {
    (0, 0): "translation",
    (1, 0): "longitudinal shortening, bending",
    (2, 0): "longitudinal, ends against middle",
    (0, 1): "radial contraction, twist, ovalisation",
    (1, 1): "radial contraction and twist, end to end",
    (2, 1): "radial contraction, ends against middle",
    (0, 2): "one-sided bulge, three lobes",
    (1, 2): "one-sided bulge, end to end",
    (0, 3): "two-sided bulge, four lobes",
}
_ROUND_LOCAL: Final[_Names] = {
    (0, 0): "radial contraction, twist, longitudinal shortening",
    (1, 0): "the same, end against end",
    (2, 0): "the same, ends against the middle",
    (0, 1): "translation, one side against the other",
    (1, 1): "bending and tilting",
    (0, 2): "ovalisation",
    (1, 2): "ovalisation, end against end",
    (0, 3): "three lobes",
}
_SHEET: Final[_Names] = {
    (0, 0): "translation",
    (1, 0): "one edge against the other",
    (0, 1): "one side against the other",
    (1, 1): "twist: corners against corners",
    (2, 0): "arching along the first axis",
    (0, 2): "arching along the second axis",
}
_CURVE: Final[_Names] = {
    (0,): "translation",
    (1,): "end against end",
    (2,): "ends against the middle",
}
_RING: Final[_Names] = {
    (0,): "translation",
    (1,): "widening and ovalising",
    (2,): "two-sided bulge",
}


def plain_name(
    topology: Topology | None,
    label: ModeLabel,
    components: Components = Components.CARTESIAN,
    *,
    along_normal: bool = False,
) -> str:
    """Describe in a few words how a surface moves in a mode.

    Parameters
    ----------
    topology : Topology or None
        None for the spring modes of one mesh.
    label : ModeLabel
    components : Components
        Directions of the amplitudes, on which the look of a mode depends.
    along_normal : bool
        The amplitude is along the normals.
    """
    p = label.wavenumbers
    if topology is None:
        return "translation" if p == (0,) and not along_normal else f"shape {p[0]} of this mesh"
    if along_normal and not any(p):
        return "all outward or all inward"
    if along_normal:
        return _counted(topology, p)
    is_local = components != Components.CARTESIAN
    if topology in (CUP, CYLINDER, SPHERE):
        table = _ROUND_LOCAL if is_local else _ROUND
    else:
        table = {PLANE: _SHEET, OPEN_CURVE: _CURVE, CLOSED_CURVE: _RING}.get(topology, {})
        if topology == TORUS and not any(p):
            return "translation"
    return table.get(p) or _counted(topology, p)


def _counted(topology: Topology, p: tuple[int, ...]) -> str:
    """Count the waves of a mode that has no name of its own."""
    n_closed = len(topology.closed_axes)
    parts = []
    for axis, count in enumerate(p):
        if not count:
            continue
        if topology.ends[axis] == CLOSED:
            which = "" if n_closed == 1 else (" first" if axis == 0 else " second")
            way = f" the{which} way" if which else ""
            # Of two closed axes a wave may run the other way round about one.
            sense = ", backwards" if count < 0 else ""
            parts.append(f"{counted(abs(count), 'wave')} around{way}{sense}")
        else:
            along = "along" if topology.n_axes == 1 or n_closed else f"along axis {axis + 1}"
            parts.append(f"{counted(count, 'half wave')} {along}")
    return ", ".join(parts) or "the whole alike"
