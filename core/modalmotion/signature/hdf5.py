"""Modal signatures as HDF5."""

from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np

from modalmotion.hdf5 import image
from modalmotion.mesh import alignment, facts_as_json, facts_from_json
from modalmotion.mesh.spring_modes import Modes, SpringModes
from modalmotion.modes import ModeSet, topologies
from modalmotion.notes import notes_from_json
from modalmotion.representation import plain
from modalmotion.signature import choice, making
from modalmotion.signature.parameters import parameters_as_json, parameters_from_json
from modalmotion.signature.value import LENGTHS_OF_FRAMES
from modalmotion.template.template import landmark_datasets, landmarks_from

FORM: Final = image.Form("signature", 7)

_ARRAYS: Final = {
    "amplitudes": ("{u}", "frame, mode, direction"),
    "amplitude_deviations": ("{u}", "frame, mode, direction"),
    "angular_frequencies": ("rad/s", "mode"),
    "reference_amplitudes": ("{u}", "mode, coordinate"),
    "volumes": ("{u}^3", "frame"),
    "translations": ("{u}", "frame, coordinate"),
    **dict.fromkeys(LENGTHS_OF_FRAMES, ("{u}", "frame")),
    "lengths": ("{u}", "axis"),
    "condition": ("1", ""),
    "n_vertices": ("1", ""),
    "times": ("s", "frame"),
}
_OPTIONAL: Final = ("amplitude_deviations", "volumes", "times")
_ROTATIONS: Final = {"matrices": ("1", "frame, row, column"), "is_determined": ("1", "frame")}
_MODES: Final = {
    "wavenumbers": ("1", "mode, axis"),
    "is_sine": ("1", "mode"),
    "spring_eigenvalues": ("1", "mode"),
    "connectivity_id": ("none", ""),
}
# For other readers.
_DERIVED: Final = {
    "deformation_spectrum": ("{u}", "mode"),
    "strain_energy": ("{u}^2/s^2", "frame, mode"),
}


def signature_to_hdf5(signature: making.ModalSignature) -> bytes:
    """Write a signature as a sealed HDF5 file in memory.

    Parameters
    ----------
    signature : ModalSignature

    Returns
    -------
    bytes
        The same for the same signature.

    Raises
    ------
    StoreError
        If HDF5 cannot contain the unit as text.
    """
    unit = signature.unit
    datasets = [
        *image.datasets_of(signature, _ARRAYS, unit),
        *mode_datasets(signature.modes),
        *image.datasets_of(signature.rotations, _ROTATIONS, prefix="rotation_"),
        _parameters_text(signature.parameters),
        image.json_text("notes", signature.notes),
        image.json_text("provenance", signature.provenance),
    ]
    # Squares of huge amplitudes overflow; their stored sums are then infinite.
    with np.errstate(over="ignore", invalid="ignore"):
        datasets += image.datasets_of(signature, _DERIVED, unit)
    # Stored signatures have no facts, which may change: the answer adds them.
    if signature.facts.stated:
        datasets.append(image.json_text("facts", facts_as_json(signature.facts)))
    if signature.choice is not None:
        datasets.append(image.json_text("choice", plain(signature.choice)))
    if signature.landmarks is not None:
        datasets += landmark_datasets(signature.landmarks, unit)
    ids = {
        "sequence_id": signature.sequence_id,
        "template_id": signature.template_id,
        "parameters_key": signature.parameters.key,
    }
    return FORM.image(ids, datasets, topology=signature.surface, unit=unit or image.UNKNOWN)


def signature_from_hdf5(
    source: bytes | Path, ids: image.Ids = image.ANY_IDS
) -> making.ModalSignature:
    """Read a signature, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path
    ids : mapping
        Attributes that it must have, such as the `parameters_key`.

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    with FORM.read(source, ids) as contents:
        parameters = parameters_from_json(contents.json("parameters", dict))
        sizes = {"direction": parameters.n_directions, "coordinate": 3, "row": 3, "column": 3}
        arrays = contents.table(_ARRAYS, sizes, optional=_OPTIONAL)
        facts = contents.json("facts", dict) if "facts" in contents.arrays else {}
        chosen = contents.json("choice", dict) if "choice" in contents.arrays else {}
        return making.ModalSignature(
            **{**arrays, "lengths": tuple(arrays["lengths"].tolist())},
            modes=_modes(contents, sizes),
            rotations=alignment.Rotations(**contents.table(_ROTATIONS, sizes, prefix="rotation_")),
            unit=contents.unit,
            landmarks=landmarks_from(contents),
            parameters=parameters,
            sequence_id=contents.text("sequence_id"),
            template_id=contents.text("template_id"),
            notes=notes_from_json(contents.json("notes", list)),
            provenance=contents.json("provenance", dict),
            choice=choice.ModelChoice.from_json(chosen) if chosen else None,
            facts=facts_from_json(facts),
        )


def mode_datasets(modes: Modes) -> list[image.Dataset]:
    """Datasets that contain the names of modes."""
    return [image.Dataset(name, array, *_MODES[name]) for name, array in modes.arrays.items()]


def _modes(contents: image.Contents, sizes: dict[str, int]) -> Modes:
    if contents.text("topology") == topologies.MESH:
        identity = bytes(contents.arrays["connectivity_id"][()]).decode()
        return SpringModes(contents.array("spring_eigenvalues", (sizes["mode"],)), identity)
    topology = topologies.Topology.parse(contents.text("topology"))
    names = {name: _MODES[name] for name in ("wavenumbers", "is_sine")}
    return ModeSet(topology, **contents.table(names, {**sizes, "axis": topology.n_axes}))


@lru_cache(maxsize=64)
def _parameters_text(parameters: making.SignatureParameters) -> image.Dataset:
    # Most signatures have the same parameters.
    return image.json_text("parameters", parameters_as_json(parameters))
