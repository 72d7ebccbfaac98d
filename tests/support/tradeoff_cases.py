"""Generated sequences, and the true error of an answer worked out naively."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import InputError, ToleranceError
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence, mesh_sequence
from modalmotion.signature.making import (
    ModalSignature,
    SignatureParameters,
    modal_signature,
    resolve_sequence,
    resolve_template,
)
from modalmotion.signature.parameters import ErrorKind
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle


def true_errors(
    signature: ModalSignature, sequence: MeshSequence
) -> dict[str, NDArray[np.float64]]:
    """Errors of each frame by the name of their field, from the reconstructed vertices."""
    asked = signature.parameters
    template = resolve_template(resolve_sequence(sequence, asked), asked)
    d = np.linalg.norm(reconstruct(signature, sequence) - sequence.vertices, axis=2)
    return {
        "rms_errors": np.sqrt((d**2).mean(axis=1)),
        "weighted_rms_errors": np.sqrt((d**2) @ template.weights),
        "p95_errors": np.sort(d, axis=1)[:, d.shape[1] - 1 - d.shape[1] // 20],
        "max_errors": d.max(axis=1),
    }


def stated_error(signature: ModalSignature, kind: ErrorKind) -> float:
    """Error that a tolerance limits."""
    return {
        ErrorKind.RMS: signature.rms_error,
        ErrorKind.WEIGHTED_RMS: signature.weighted_rms_error,
        ErrorKind.MAX: signature.max_error,
    }[kind]


def random_sequence(rng: np.random.Generator) -> MeshSequence:
    """Draw a ventricle, a wobbling lattice or a curve, in any unit and type."""
    kind = rng.integers(4)
    n_frames = int(rng.integers(1, 9))
    if kind < 2:
        size: dict[str, Any] = {"grid": (6, 12)} if kind else {"n_vertices": 120}
        beat = simulate_ventricle(
            VentricleParameters(motion_variation=2.0, shape_variation=2.0),
            acquisition=Acquisition(n_frames=n_frames, noise=float(rng.choice([0.0, 0.3]))),
            rng=rng,
            **size,
        )
        unit = str(rng.choice(list(MM_PER_UNIT)))
        vertices = beat.vertices / MM_PER_UNIT[unit]
        if rng.integers(2):
            vertices = vertices.astype(np.float32)
        return mesh_sequence(
            vertices,
            beat.faces,
            grid=beat.grid,
            topology=beat.topology,
            times=beat.times,
            unit=unit,
        )
    if kind == 2:
        topology = str(rng.choice(["plane", "cylinder", "torus", "cup", "sphere"]))
        grid: tuple[int, ...] = (int(rng.integers(2, 7)), 2 * int(rng.integers(2, 5)))
    else:
        topology = str(rng.choice(["open curve", "closed curve"]))
        grid = (int(rng.integers(4, 30)),)
    n = int(np.prod(grid))
    start = rng.normal(size=(n, 3)) * rng.uniform(1.0, 50.0)
    steps = rng.normal(size=(n_frames, n, 3)) * rng.uniform(0.0, 3.0)
    steps[0] = 0.0
    times = np.sort(rng.uniform(0.0, 1.0, n_frames)) if rng.integers(2) else None
    if times is not None and len(np.unique(times)) < n_frames:
        times = None
    return mesh_sequence(start + steps, grid=grid, topology=topology, unit="mm", times=times)


def random_request(rng: np.random.Generator, sequence: MeshSequence) -> SignatureParameters:
    """Draw a request of any kind that the sequence might be asked."""
    said: dict[str, Any] = {"tolerance_of": ErrorKind(rng.choice(["rms", "weighted_rms", "max"]))}
    way = rng.integers(4)
    if way == 0:
        said["modes"] = int(rng.integers(1, 10))
    elif way == 1:
        said["auto"] = True
    else:
        said["tolerance"] = float(10.0 ** rng.uniform(-1.0, 1.2))
    if rng.integers(4) == 0 and sequence.n_frames > 4:
        said["harmonics"] = int(rng.integers(0, (sequence.n_frames - 2) // 2 + 1))
    said["reference"] = int(rng.integers(sequence.n_frames))
    said["remove_rotation"] = bool(rng.integers(4))
    return SignatureParameters(**said)


def violations(rng: np.random.Generator) -> list[str]:
    """Ask one random sequence one random question, and list what is wrong with the answer."""
    sequence = random_sequence(rng)
    return violations_of(sequence, random_request(rng, sequence))


def violations_of(sequence: MeshSequence, asked: SignatureParameters) -> list[str]:
    """What is wrong with the answer to a request; nothing if it is refused for good reason."""
    try:
        signature = modal_signature(sequence, asked)
    except ToleranceError as error:
        return refusal_violations(sequence, asked, error)
    except InputError:
        return []
    size = float(np.abs(sequence.vertices).max()) + 1e-300
    found = []
    for name, true in true_errors(signature, sequence).items():
        stated = getattr(signature, name)
        if np.abs(stated - true).max() > 1e-11 * size:
            found.append(f"{name} {stated} is not {true}: {asked}")
    limit = None
    if asked.tolerance is not None:
        limit = asked.tolerance / MM_PER_UNIT[sequence.unit or "mm"]
    own = stated_error(signature, asked.tolerance_of)
    if limit is not None and own > limit:
        found.append(f"{own} exceeds {limit}: {asked}")
    return found


def refusal_violations(
    sequence: MeshSequence, asked: SignatureParameters, error: ToleranceError
) -> list[str]:
    """What is wrong with a refusal: its best must be what such a model leaves, and too much."""
    best, count = error.details["best_error"], error.details["best_modes"]
    limit = error.details["limit_asked"]
    assert isinstance(best, float)
    assert isinstance(count, int)
    assert isinstance(limit, float)
    found = [] if best > limit else [f"{best} would have held {limit}: {asked}"]
    signature = modal_signature(sequence, replace(asked, modes=count, tolerance=None))
    stated = stated_error(signature, asked.tolerance_of)
    if abs(stated - best) > 1e-9 * best + 1e-12 * float(np.abs(sequence.vertices).max()):
        found.append(f"{count} modes leave {stated}, not {best}: {asked}")
    return found
