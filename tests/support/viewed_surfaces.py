"""Small moving surfaces of every topology, and what a page must show of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.mesh.sequence import MeshSequence, mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CUP, CYLINDER, PLANE, SPHERE, TORUS
from modalmotion.signature.making import ModalSignature, modal_signature
from modalmotion.signature.parameters import SignatureKind, SignatureParameters
from modalmotion.template.body_frame import Components

VIEWED: Final = (
    "cup",
    "cylinder",
    "sphere",
    "plane",
    "torus",
    "mesh",
    "local",
    "normal displacement",
)
_TOPOLOGIES: Final = {t.name: t for t in (CUP, CYLINDER, SPHERE, PLANE, TORUS)}


def viewed(name: str) -> tuple[MeshSequence, ModalSignature]:
    """A surface that widens, bends, turns and drifts, far from the origin, and its signature."""
    topology = _TOPOLOGIES.get(name, CUP)
    still = standard_surface(Lattice(topology, (9, 12)))
    x = 20.0 * np.asarray(still.vertices[0], dtype=np.float64)
    frames = []
    for t in np.linspace(0.0, 1.0, 5, endpoint=False):
        beat = np.sin(np.pi * t) ** 2
        y = x * (1.0 - 0.2 * beat * (1.0 + 0.3 * np.sin(x[:, :1] / 9.0)))
        y[:, 2] += 0.02 * beat * y[:, 0] ** 2
        turn = Rotation.from_rotvec(
            [0.1 * beat, -0.2 * beat, 0.3 * np.sin(2 * np.pi * t)]
        ).as_matrix()
        frames.append(y @ turn.T + [400.0 + 3.0 * beat, -250.0, 40.0 * beat])
    is_mesh = name == "mesh"
    sequence = mesh_sequence(
        np.stack(frames),
        still.faces,
        grid=None if is_mesh else still.grid,
        topology=None if is_mesh else topology,
        times=0.2 * np.arange(5),
        unit="mm",
    )
    kinds: dict[str, dict[str, Any]] = {
        "mesh": {"topology": "mesh"},
        "local": {"components": Components.CYLINDRICAL},
        "normal displacement": {"kind": SignatureKind.NORMAL_DISPLACEMENT},
    }
    kind = kinds.get(name, {})
    return sequence, modal_signature(sequence, SignatureParameters(modes=9, **kind))


def scaled(signature: ModalSignature, gains: NDArray[np.float64]) -> ModalSignature:
    """The signature with the amplitudes of each of its modes times a factor."""
    return replace(signature, amplitudes=signature.amplitudes * gains[None, :, None])
