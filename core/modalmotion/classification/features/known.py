"""What is known of one signature, for all that read it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.centred import CentredMotions
from modalmotion.classification.features.columns import MotionValues
from modalmotion.classification.features.motion_terms import Motion
from modalmotion.classification.features.temporal import Turns
from modalmotion.signature.first_modes import first_modes
from modalmotion.signature.making import ModalSignature


class KnownFeatures:
    """What readers have read of one signature, for other readers of it.

    It lives as long as one answer: nothing in it outlasts the signature.

    Attributes
    ----------
    features : dict
        Features of the motion, by all that they depend on: see `FeatureReader.motion_key`.
    described : dict
        Those of them that depend on nothing learned: see `FeatureReader.terms_key`.
    further : dict
        Features beside the motion.
    """

    def __init__(self) -> None:
        self.features: dict[tuple[object, ...], MotionValues] = {}
        self.described: dict[tuple[object, ...], NDArray[np.float64]] = {}
        self.further: dict[tuple[object, ...], NDArray[np.float64]] = {}
        self._first: dict[int, ModalSignature] = {}
        self._turns: Turns | None = None
        self._centred: CentredMotions | None = None
        self._motion: Motion | None = None

    def turns(self, signature: ModalSignature) -> Turns:
        """One turn of the signature, which is always the same one."""
        if self._turns is None:
            self._turns = Turns(signature)
        return self._turns

    def centred(self, signature: ModalSignature) -> CentredMotions:
        """Centred motion of the signature."""
        if self._centred is None:
            self._centred = CentredMotions(signature, self.turns(signature))
        return self._centred

    def motion(self, signature: ModalSignature) -> Motion:
        """Motion of the signature, whose terms are fitted together."""
        if self._motion is None:
            self._motion = Motion(signature, self.turns(signature))
        return self._motion

    def first_modes(self, signature: ModalSignature, n_modes: int) -> ModalSignature:
        """First modes of the signature; all for 0."""
        if not n_modes:
            return signature
        if n_modes not in self._first:
            self._first[n_modes] = first_modes(signature, n_modes)
        return self._first[n_modes]
