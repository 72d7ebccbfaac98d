"""A mesh moved by weighted targets, and as a whole by rotation and translation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ShapeError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import Topology
from modalmotion.representation import shown


@shown("targets", "weights", "unit", "rms_left_out", "faces")
@dataclass(frozen=True, eq=False)
class MorphAnimation:
    """Positions over time as x(t) = R(t) (base + sum_i w_i(t) target_i) + T(t).

    Parameters
    ----------
    base : (vertices, 3) float64, in `unit`
    targets : (targets, vertices, 3) float32 or float64, in `unit` for a weight of one
    target_names : tuple of str
    weights : (frames, targets) float64
    rotations : (frames, 3, 3) float64
    translations : (frames, 3) float64, in `unit`
    faces : (faces, 3) int64
    times : (frames,) float64, s, optional
    unit : str, optional
    topology : Topology, optional
    grid : tuple of int, optional
    n_left_out : int
        Requested targets that were left out.
    rms_left_out : float, in `unit`
        RMS over vertices and frames of the displacement that they describe.

    Raises
    ------
    ShapeError
        If the arrays do not fit each other.
    """

    base: NDArray[np.float64]
    targets: NDArray[np.float64] | NDArray[np.float32]
    target_names: tuple[str, ...]
    weights: NDArray[np.float64]
    rotations: NDArray[np.float64]
    translations: NDArray[np.float64]
    faces: NDArray[np.int64]
    times: NDArray[np.float64] | None = None
    unit: str | None = None
    topology: Topology | None = None
    grid: tuple[int, ...] | None = None
    n_left_out: int = 0
    rms_left_out: float = 0.0

    def __post_init__(self) -> None:
        n_frames, n_targets = self.weights.shape
        for name, array, shape in (
            ("base", self.base, (len(self.base), 3)),
            ("targets", self.targets, (n_targets, len(self.base), 3)),
            ("rotations", self.rotations, (n_frames, 3, 3)),
            ("translations", self.translations, (n_frames, 3)),
            ("times", self.times, (n_frames,)),
        ):
            if array is not None and array.shape != shape:
                raise ShapeError(
                    f"{name!r} has the shape {array.shape}, not {shape}: there are {n_frames} "
                    f"frames of {n_targets} weights.",
                    remedy="Give every frame its weights, rotation, translation and time.",
                    details={"array": name, "shape": list(array.shape)},
                )

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.weights)

    def positions(self) -> NDArray[np.float64]:
        """Positions of all frames, (frames, vertices, 3) float64, in `unit`."""
        u = np.tensordot(self.weights, self.targets, axes=(1, 0))
        # x(t) = R(t) (base + u(t)) + T(t)
        x: NDArray[np.float64] = np.matmul(self.base + u, self.rotations.transpose(0, 2, 1))
        return x + self.translations[:, None, :]


def frame_animation(sequence: MeshSequence) -> MorphAnimation:
    """Make every frame but the first one a target, which its own frame has the weight 1 of.

    Parameters
    ----------
    sequence : MeshSequence

    Returns
    -------
    MorphAnimation
        At the keyframes the positions of the sequence.
    """
    n = sequence.n_frames
    x = sequence.vertices.astype(np.float64)
    return MorphAnimation(
        base=x[0],
        targets=x[1:] - x[0],
        target_names=tuple(f"frame {k}" for k in range(1, n)),
        weights=np.eye(n)[:, 1:],
        rotations=np.broadcast_to(np.eye(3), (n, 3, 3)),
        translations=np.zeros((n, 3)),
        faces=sequence.faces,
        times=sequence.times,
        unit=sequence.unit,
        topology=sequence.topology,
        grid=sequence.grid,
    )
