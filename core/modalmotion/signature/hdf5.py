"""Modal signatures as HDF5."""

from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.hdf5.image import UNKNOWN, Contents, Dataset, Form, json_text
from modalmotion.mesh import alignment, facts_as_json, facts_from_json
from modalmotion.mesh.spring_modes import Modes, SpringModes
from modalmotion.modes import ModeSet, topologies
from modalmotion.notes import notes_from_json
from modalmotion.representation import plain
from modalmotion.signature import choice, making
from modalmotion.signature.parameters import parameters_as_json, parameters_from_json
from modalmotion.signature.value import LENGTHS_OF_FRAMES
from modalmotion.template.template import landmark_datasets, landmarks_from

FORM: Final = Form("signature", 6)

# Unit and axes of what names modes.
_OF_MODES: Final = {
    "wavenumbers": ("1", "mode, axis"),
    "is_sine": ("1", "mode"),
    "spring_eigenvalues": ("1", "mode"),
    "connectivity_id": ("none", ""),
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
    unit, determined = signature.unit or UNKNOWN, signature.rotations.is_determined
    ids = {
        "sequence_id": signature.sequence_id,
        "template_id": signature.template_id,
        "parameters_key": signature.parameters.key,
    }
    # Squares of huge amplitudes overflow; their stored sums are then infinite.
    with np.errstate(over="ignore", invalid="ignore"):
        spectrum, energy = signature.deformation_spectrum, signature.strain_energy
    datasets = [
        Dataset("amplitudes", signature.amplitudes, unit, "frame, mode, direction"),
        *mode_datasets(signature.modes),
        Dataset("angular_frequencies", signature.angular_frequencies, "rad/s", "mode"),
        Dataset("rotations", signature.rotations.matrices, "1", "frame, row, column"),
        Dataset("rotation_is_determined", determined.astype(np.uint8), "1", "frame"),
        Dataset("reference_amplitudes", signature.reference_amplitudes, unit, "mode, direction"),
        Dataset("translations", signature.translations, unit, "frame, direction"),
        *(Dataset(name, getattr(signature, name), unit, "frame") for name in LENGTHS_OF_FRAMES),
        Dataset("lengths", np.array(signature.lengths, dtype=np.float64), unit, "axis"),
        Dataset("condition", np.array(signature.condition, dtype=np.float64), "1", ""),
        Dataset("n_vertices", np.array(signature.n_vertices, dtype=np.int64), "1", ""),
        Dataset("deformation_spectrum", spectrum, unit, "mode"),
        Dataset("strain_energy", energy, f"{unit}^2/s^2", "frame, mode"),
        _parameters_text(signature.parameters),
        json_text("notes", signature.notes),
        json_text("provenance", signature.provenance),
    ]
    # Stored signatures have no facts, which may change: the answer adds them.
    if signature.facts.stated:
        datasets.append(json_text("facts", facts_as_json(signature.facts)))
    if signature.choice is not None:
        datasets.append(json_text("choice", plain(signature.choice)))
    if signature.landmarks is not None:
        datasets += landmark_datasets(signature.landmarks, unit)
    optional = (
        ("volumes", f"{unit}^3", "frame"),
        ("amplitude_deviations", unit, "frame, mode, direction"),
        ("times", "s", "frame"),
    )
    for name, of, axes in optional:
        if (values := getattr(signature, name)) is not None:
            datasets.append(Dataset(name, values, of, axes))
    return FORM.image(ids, datasets, topology=signature.surface, unit=unit)


def signature_from_hdf5(source: bytes | Path) -> making.ModalSignature:
    """Read a signature, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    return read_signature(source)[0]


def read_signature(source: bytes | Path) -> tuple[making.ModalSignature, Contents]:
    """Read a signature together with the contents of its file."""
    with FORM.read(source) as contents:
        return _signature(contents), contents


def _signature(contents: Contents) -> making.ModalSignature:
    parameters = parameters_from_json(contents.json("parameters", dict))
    amplitudes = contents.array("amplitudes", (None, None, parameters.n_directions))
    n_frames, n_modes, _ = amplitudes.shape

    def optional(name: str, *shape: int) -> Any:
        return contents.array(name, shape) if name in contents.arrays else None

    chosen = contents.json("choice", dict) if "choice" in contents.arrays else {}
    return making.ModalSignature(
        modes=_modes(contents, n_modes),
        amplitudes=amplitudes,
        angular_frequencies=contents.array("angular_frequencies", (n_modes,)),
        rotations=alignment.Rotations(
            contents.array("rotations", (n_frames, 3, 3)),
            contents.array("rotation_is_determined", (n_frames,)).astype(np.bool_),
        ),
        reference_amplitudes=contents.array("reference_amplitudes", (n_modes, 3)),
        volumes=optional("volumes", n_frames),
        translations=contents.array("translations", (n_frames, 3)),
        **{name: contents.array(name, (n_frames,)) for name in LENGTHS_OF_FRAMES},
        times=optional("times", n_frames),
        unit=contents.unit,
        n_vertices=contents.number("n_vertices"),
        lengths=tuple(contents.array("lengths", (None,)).tolist()),
        landmarks=landmarks_from(contents),
        condition=contents.number("condition"),
        parameters=parameters,
        sequence_id=contents.text("sequence_id"),
        template_id=contents.text("template_id"),
        notes=notes_from_json(contents.json("notes", list)),
        provenance=contents.json("provenance", dict),
        choice=choice.ModelChoice.from_json(chosen) if chosen else None,
        amplitude_deviations=optional("amplitude_deviations", *amplitudes.shape),
        facts=facts_from_json(contents.json("facts", dict) if "facts" in contents.arrays else {}),
    )


def mode_datasets(modes: Modes) -> list[Dataset]:
    """Datasets that contain the names of modes."""
    return [Dataset(name, array, *_OF_MODES[name]) for name, array in modes.arrays.items()]


def _modes(contents: Contents, n_modes: int) -> Modes:
    if contents.text("topology") == topologies.MESH:
        identity = bytes(contents.arrays["connectivity_id"][()]).decode()
        return SpringModes(contents.array("spring_eigenvalues", (n_modes,)), identity)
    topology = topologies.Topology.parse(contents.text("topology"))
    return ModeSet(
        topology,
        contents.array("wavenumbers", (n_modes, topology.n_axes)),
        contents.array("is_sine", (n_modes,)).astype(np.bool_),
    )


@lru_cache(maxsize=64)
def _parameters_text(parameters: making.SignatureParameters) -> Dataset:
    # Most signatures have the same parameters.
    return json_text("parameters", parameters_as_json(parameters))
