"""A trade as plain values, for JSON."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from modalmotion.choice.scene import NUMBERS
from modalmotion.tradeoff.answer import Tradeoff
from modalmotion.tradeoff.chosen import Chosen
from modalmotion.tradeoff.front import Branch, Front


def as_plain(tradeoff: Tradeoff) -> dict[str, Any]:
    """Write a trade out as dicts, lists, numbers and text.

    Parameters
    ----------
    tradeoff : Tradeoff
    """
    front = tradeoff.front
    return {
        "sequence_id": tradeoff.sequence_id,
        "unit": front.unit,
        "n_frames": front.n_frames,
        "n_vertices": front.n_vertices,
        "motion_rms": front.motion_rms,
        "weighted_motion_rms": front.weighted_motion_rms,
        "front": [_branch(branch, front) for branch in front.branches],
        "scene": {
            kind.value: {**asdict(error), "numbers_per_frame": NUMBERS.get(kind)}
            for kind, error in tradeoff.scene.errors.items()
        },
        "limit": tradeoff.limit,
        "noise": None if tradeoff.noise is None else asdict(tradeoff.noise),
        "chosen": _chosen(tradeoff.chosen),
        "fit_milliseconds": {str(n): ms for n, ms in tradeoff.fit_milliseconds.items()},
        "milliseconds": dict(tradeoff.milliseconds),
    }


def _branch(branch: Branch, front: Front) -> dict[str, Any]:
    return {
        "topology": branch.topology,
        "components": branch.components.value,
        "modes": branch.counts.tolist(),
        "amplitudes_per_frame": (3 * branch.counts).tolist(),
        "bytes": [8 * front.numbers(n) for n in branch.counts.tolist()],
        "rms": branch.rms.tolist(),
        "weighted_rms": branch.weighted_rms.tolist(),
        "harmonics": list(range(branch.joint_rms.shape[1])),
        "rms_by_harmonics": branch.joint_rms.tolist(),
        "weighted_rms_by_harmonics": branch.weighted_joint_rms.tolist(),
        "condition": branch.condition,
        "ends_because": branch.ends_because,
    }


def _chosen(chosen: Chosen) -> dict[str, Any]:
    signature, motion = chosen.signature, chosen.motion
    plain: dict[str, Any] = {
        "kind": chosen.kind.value,
        "price": asdict(chosen.price),
        "notes": list(chosen.notes),
    }
    if signature is not None:
        parameters = signature.parameters
        plain |= {
            "topology": signature.surface,
            "components": parameters.components.value,
            "modes": len(signature.modes),
            "labels": [str(label) for label in signature.modes.labels],
            "harmonics": parameters.harmonics,
            "notes": [*signature.notes, *chosen.notes],
        }
    if motion is not None:
        plain |= {"matrices": motion.matrices.tolist(), "shifts": motion.shifts.tolist()}
    return plain
