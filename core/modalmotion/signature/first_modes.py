"""The first modes of a signature, as a smaller one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from modalmotion.modes.mode_set import Modes, whole_counts
from modalmotion.signature.value import ModalSignature


def whole_count(modes: Modes, n: int) -> int:
    """Give the number of first modes, at least n, that splits no cosine-sine pair."""
    counts = whole_counts(modes)
    return int(counts[min(int(np.searchsorted(counts, n)), len(counts) - 1)])


def first_modes(signature: ModalSignature, n: int) -> ModalSignature:
    """Keep the first modes alone, with the amplitudes that the fit of all modes gave them.

    Parameters
    ----------
    signature : ModalSignature
    n : int
        At most as many as it has. Its errors and notes stay those of all.

    Returns
    -------
    ModalSignature
    """
    if n == len(signature.modes):
        return signature
    deviations = signature.amplitude_deviations
    return replace(
        signature,
        modes=signature.modes.take(np.arange(n)),
        amplitudes=signature.amplitudes[:, :n],
        angular_frequencies=signature.angular_frequencies[:n],
        reference_amplitudes=signature.reference_amplitudes[:n],
        amplitude_deviations=None if deviations is None else deviations[:, :n],
    )
