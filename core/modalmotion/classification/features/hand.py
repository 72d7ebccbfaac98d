"""Handedness of a recording: its image in a mirror, and the readings that its shape allows."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.axis import READINGS
from modalmotion.classification.features.axis_parts import has_axis, parts_of
from modalmotion.facts import UNKNOWN, Facts
from modalmotion.facts.facts import Handedness
from modalmotion.signature.making import ModalSignature, SignatureKind
from modalmotion.template import Landmarks

_OTHER: Final[dict[Handedness, Handedness]] = {"left": "right", "right": "left"}
_FLIP: Final = np.array([-1.0, 1.0, 1.0])


def hand_of(facts: Facts) -> Handedness:
    """Give the handedness that facts state; coordinates of a patient are right-handed."""
    return "right" if facts.coordinates != UNKNOWN else facts.handedness


def mirrored(signature: ModalSignature) -> ModalSignature:
    """Signature of the same motion in coordinates of the other handedness.

    Only what features are read from is the mirror image: amplitudes and landmarks. Where the shape
    says which way theta runs it runs right-handed again; columns of a lattice stay as they are.
    """
    # An offset outward stays one in a mirror.
    is_offset = signature.kind == SignatureKind.OFFSET
    amplitudes = signature.amplitudes * (1.0 if is_offset else _FLIP)
    reference = signature.reference_amplitudes * _FLIP
    if theta_is_of_the_shape(signature):
        sines = signature.modes.is_sine
        amplitudes[:, sines] *= -1.0
        reference[sines] *= -1.0
    landmarks = signature.landmarks
    facts, hand = signature.facts, hand_of(signature.facts)
    if hand != UNKNOWN:
        facts = replace(facts, handedness=_OTHER[hand], coordinates=UNKNOWN)
    return replace(
        signature,
        amplitudes=amplitudes,
        reference_amplitudes=reference,
        landmarks=None if landmarks is None else _image(landmarks),
        facts=facts,
    )


def right_handed(signature: ModalSignature) -> ModalSignature:
    """Signature as it would be in right-handed coordinates, if it states left-handed ones."""
    return mirrored(signature) if hand_of(signature.facts) == "left" else signature


def theta_is_of_the_shape(signature: ModalSignature) -> bool:
    """Whether theta is right-handed about the axis, and not as the columns of a lattice run."""
    return signature.landmarks is not None and "grid" not in signature.landmarks.given


def readings_of(signature: ModalSignature) -> NDArray[np.bool_]:
    """Which of `READINGS` the shape of a surface with an axis allows, (readings,) bool.

    Those in which the axis of the motion, about which theta is right-handed, runs from the apex
    end to the base end; all where the axis is not known. Offsets have no axis of their own: where
    the shape gives theta its sense they are those in which it is right-handed.
    """
    both = np.array([reading.is_mirrored for reading in READINGS])
    if signature.landmarks is None or not has_axis(signature):
        return np.ones(len(READINGS), dtype=np.bool_)
    if signature.kind == SignatureKind.OFFSET:
        return ~both if theta_is_of_the_shape(signature) else np.ones_like(both)
    a = signature.amplitudes - signature.amplitudes.mean(axis=0)
    parts = parts_of(signature.modes)
    c, s = a[:, parts.cosines[parts.first]], a[:, parts.sines[parts.first]]
    m = np.einsum("fki,fkj->ij", c, s)
    e3 = np.array([m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]])
    return np.asarray(both == (e3 @ signature.landmarks.axis < 0.0))


def _image(landmarks: Landmarks) -> Landmarks:
    return replace(
        landmarks,
        origin=landmarks.origin * _FLIP,
        axis=landmarks.axis * _FLIP,
        theta_zero=landmarks.theta_zero * _FLIP,
        apex=landmarks.apex * _FLIP,
        base=landmarks.base * _FLIP,
    )
