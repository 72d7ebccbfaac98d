"""What a training case must be, by itself and beside the others."""

from __future__ import annotations

from typing import TYPE_CHECKING

from modalmotion.classify.options import TrainingOptions
from modalmotion.classify.training.cases import TrainingCase
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MEAN
from modalmotion.mesh.spring_modes import SpringSpectrum

if TYPE_CHECKING:
    from modalmotion.classify.training.case_reading import ReadCase


def require_usable(case: TrainingCase, number: int, options: TrainingOptions) -> None:
    """Check that a case has a label, a motion and the modes that are asked for.

    Raises
    ------
    ParameterError
        Naming the case.
    """
    signature = case.signature
    if not str(case.label or "").strip():
        raise ParameterError(
            f"The training case {number} has no label.",
            remedy="Give every case the name of its class, or leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
    if signature.n_frames < 2:
        raise ParameterError(
            f"The training case {number} has one frame, which shows no motion.",
            remedy="Leave it out.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
    asked = signature.parameters.modes
    if options.modes not in (asked, len(signature.modes)):
        raise ParameterError(
            f"The training case {number} has {len(signature.modes)} modes, but {options.modes} "
            "were asked for.",
            remedy=f"Fit the signatures with modes={options.modes}.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )


def require_alike(read: ReadCase, example: ReadCase, number: int) -> None:
    """Check that a case has the modes of the first.

    Raises
    ------
    ParameterError
        Naming the case.
    """
    a, b = read.parameters, example.parameters
    same = (
        a.weights == b.weights
        and a.remove_rotation == b.remove_rotation
        and a.components == b.components
        and (a.reference == MEAN) == (b.reference == MEAN)
        and len(read.modes) == len(example.modes)
        and isinstance(read.modes, SpringSpectrum) == isinstance(example.modes, SpringSpectrum)
    )
    if same and isinstance(read.modes, SpringSpectrum):
        assert isinstance(example.modes, SpringSpectrum)  # noqa: S101 (just compared)
        if read.modes.connectivity_id != example.modes.connectivity_id:
            raise ParameterError(
                f"The training case {number} is of another mesh than the first, and spring modes "
                "compare within one mesh only.",
                remedy="Give recordings of one mesh, or of surfaces with natural coordinates.",
                details={"case": number, "sequence_id": read.row.sequence_id},
            )
    if not same:
        raise ParameterError(
            f"The training cases differ in their modes: case {number} has {len(read.modes)} "
            f"of a {read.surface}, {a.components}, weights {a.weights}, reference {a.reference}; "
            f"the first has {len(example.modes)} of a {example.surface}, {b.components}, weights "
            f"{b.weights}, reference {b.reference}.",
            remedy="Fit all signatures with the same parameters.",
            details={"case": number, "sequence_id": read.row.sequence_id},
        )
