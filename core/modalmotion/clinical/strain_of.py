"""Strain of a sequence, a track, or a signature."""

from __future__ import annotations

import numpy as np

from modalmotion.clinical.strain import Strain, wall_strain
from modalmotion.errors import ParameterError
from modalmotion.mesh import cavity_of
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.reconstruction import fitted_on
from modalmotion.template import Template, make_template
from modalmotion.tracking.result import Track


def strain(
    recording: MeshSequence | Track | ModalSignature,
    sequence: MeshSequence | None = None,
    *,
    template: Template | None = None,
) -> Strain:
    """Measure GLS, GCS, GAS, segmental strain and dyssynchrony, with 95 % intervals.

    Parameters
    ----------
    recording : MeshSequence, Track or ModalSignature
    sequence : MeshSequence, optional
        The one that a signature was made from: required with a signature.
    template : Template, optional
        The one that the signature's parameters name, or one for a sequence.

    Returns
    -------
    Strain
        Since the frame of the largest volume; at end systole that of the smallest.

    Raises
    ------
    TopologyError
        If the surface encloses nothing, or is not a cup, tube or sphere.
    ParameterError
        If the mesh has too few vertices, or this is none of the three.

    Examples
    --------
    >>> import modalmotion as mm
    >>> beat = mm.simulate_ventricle()
    >>> round(mm.strain(beat).end_systolic["GLS"].value)
    -21
    """
    if isinstance(recording, Track):
        measured, used = recording.sequence, recording.template
    elif isinstance(recording, ModalSignature):
        if sequence is None:
            raise ParameterError(
                "A signature alone has no shape that strain could be measured on.",
                remedy="Give its sequence as well: strain(signature, sequence).",
            )
        measured, used = sequence, fitted_on(recording, sequence, template)
    elif isinstance(recording, MeshSequence):
        measured, used = recording, template or make_template(recording)
    else:
        raise ParameterError(
            f"Strain was requested of {type(recording).__name__}.",
            remedy="Give a mesh sequence, a track, or a signature with its sequence.",
        )
    cavity = cavity_of(used.faces, used.n_vertices)
    volumes = np.abs(cavity.volume(measured.vertices.astype(np.float64)))
    return wall_strain(measured, used, int(volumes.argmax()), int(volumes.argmin()))
