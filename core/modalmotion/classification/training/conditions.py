"""Conditions of a recording: what is known of it beside its motion."""

from __future__ import annotations

from collections.abc import Mapping

from modalmotion.signature.making import ModalSignature

Conditions = Mapping[str, float | str]
"""By name; what is not known of a recording is left out."""


def conditions_of(signature: ModalSignature) -> Conditions:
    """Frames, frame rate (Hz), vertices, modality, and the covariates that the sender states."""
    facts = signature.facts
    conditions: dict[str, float | str] = {
        "frames": signature.n_frames,
        "vertices": signature.n_vertices,
    }
    times = signature.times
    if times is not None and signature.n_frames > 1 and times[-1] > times[0]:
        rate = float((signature.n_frames - 1) / (times[-1] - times[0]))
        # Times have been rounded, and rates are compared for equality.
        conditions["frame rate"] = float(f"{rate:.3g}")
    if facts.modality is not None:
        conditions["modality"] = facts.modality
    for name, value in facts.covariates.items():
        conditions[name if name not in conditions else f"covariate {name}"] = value
    return conditions
