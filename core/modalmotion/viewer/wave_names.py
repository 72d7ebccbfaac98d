"""The name of a wave by how it moved: shortening or bending, contraction, twist or ovalisation."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CUP, CYLINDER, SPHERE
from modalmotion.signature.making import ModalSignature, SignatureKind
from modalmotion.signature.mode_names import plain_name
from modalmotion.template import Template
from modalmotion.template.body_frame import Components

# A part of a wave that has this share of its motion names it alone.
_MOST: Final = 0.5

_ALONG: Final = ("", ", end to end", ", ends against middle")


def wave_name(signature: ModalSignature, template: Template, modes: list[int]) -> str:
    """Name a cosine with its sine by the part that moved most, or by all that they may be.

    Parameters
    ----------
    signature : ModalSignature
    template : Template
    modes : list of int
        Places of the cosine and, where there is one, of its sine.
    """
    label = signature.modes.labels[modes[0]]
    is_offset = signature.kind == SignatureKind.OFFSET
    components = signature.parameters.components
    all_of_it = plain_name(signature.topology, label, components, is_offset=is_offset)
    if is_offset or signature.topology not in (CUP, CYLINDER, SPHERE):
        return all_of_it
    r, around = label.wavenumbers
    a = signature.amplitudes[:, modes] - signature.amplitudes[:, modes].mean(axis=0)
    if components != Components.CARTESIAN:
        if around:
            return all_of_it
        names = ("radial contraction", "twist", "longitudinal shortening")
        parts = dict(zip(names, a[:, 0].T, strict=True))
        after = ("", ", end against end", ", ends against middle")
    elif not around and r:
        along = a[:, 0] @ _axes(template)[2]
        rest = np.sqrt(np.maximum((a[:, 0] ** 2).sum(axis=1) - along**2, 0.0))
        parts = {"longitudinal shortening": along, "bending": rest}
        after = ("", "", ", ends against middle")
    elif around == 1 and len(modes) == 2:
        x, y, z = _axes(template)
        (cx, cy, cz), (sx, sy, sz) = ([a[:, k] @ axis for axis in (x, y, z)] for k in (0, 1))
        # cos e_x + sin e_y is the radial direction, cos e_y - sin e_x the tangential one.
        parts = {
            "radial contraction": (cx + sy) / np.sqrt(2.0),
            "twist": (cy - sx) / np.sqrt(2.0),
            "ovalisation": np.hypot(cx - sy, cy + sx) / np.sqrt(2.0),
            "tilting": np.hypot(cz, sz),
        }
        after = _ALONG
    else:
        return all_of_it
    energies = {name: float(path @ path) for name, path in parts.items()}
    name, most = max(energies.items(), key=lambda item: item[1])
    if r >= len(after) or not most >= _MOST * sum(energies.values()) > 0.0:
        return all_of_it
    return name + after[r]


def _axes(template: Template) -> NDArray[np.float64]:
    """Directions of theta = 0 and of a quarter turn, and of the axis: rows of (3, 3)."""
    theta = 2.0 * np.pi * template.coordinates[:, 1]
    x, y = (template.weights * np.stack([np.cos(theta), np.sin(theta)])) @ template.vertices
    x = x / (np.linalg.norm(x) or 1.0)
    y = y - (y @ x) * x
    y = y / (np.linalg.norm(y) or 1.0)
    return np.stack([x, y, np.cross(x, y)])
