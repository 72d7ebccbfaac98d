"""What a training case must be, by itself and beside the others."""

from __future__ import annotations

from modalmotion.classify.cases import TrainingCase
from modalmotion.classify.options import TrainingOptions
from modalmotion.errors import ParameterError
from modalmotion.signature import ModalSignature
from modalmotion.spring_modes import SpringSpectrum


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
            details={"case": number},
        )


def require_alike(signature: ModalSignature, example: ModalSignature, number: int) -> None:
    """Check that a signature has the modes of the first.

    Raises
    ------
    ParameterError
        Naming the case.
    """
    a, b = signature.parameters, example.parameters
    same = (
        a.weights == b.weights
        and a.remove_rotation == b.remove_rotation
        and a.components == b.components
        and len(signature.modes) == len(example.modes)
        and isinstance(signature.modes, SpringSpectrum) == isinstance(example.modes, SpringSpectrum)
    )
    if same and isinstance(signature.modes, SpringSpectrum):
        assert isinstance(example.modes, SpringSpectrum)  # noqa: S101 (just compared)
        if signature.modes.connectivity_id != example.modes.connectivity_id:
            raise ParameterError(
                f"The training case {number} is of another mesh than the first, and spring modes "
                "compare within one mesh only.",
                remedy="Give recordings of one mesh, or of surfaces with natural coordinates.",
                details={"case": number, "sequence_id": signature.sequence_id},
            )
    if not same:
        raise ParameterError(
            f"The training cases differ in their modes: case {number} has {len(signature.modes)} "
            f"of a {signature.surface}, {a.components}, weights {a.weights}; the first has "
            f"{len(example.modes)} of a {example.surface}, {b.components}, weights {b.weights}.",
            remedy="Fit all signatures with the same parameters.",
            details={"case": number, "sequence_id": signature.sequence_id},
        )
