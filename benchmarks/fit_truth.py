"""What a fit of noisy positions is worth, where the positions without noise are known."""

from __future__ import annotations

import numpy as np
from mixed_noise import with_noise
from noisy_surfaces import Floats

import modalmotion as mm
from modalmotion.fit.basis import make_basis
from modalmotion.template import choose_modes, make_template


def excess_of(clean: mm.MeshSequence, noisy: mm.MeshSequence, kept: int) -> float:
    """Distance from the motion without noise over that of the best whole set."""
    template = make_template(noisy)
    asked = mm.SignatureParameters(modes=max(200, kept), template=template.id)
    found = mm.modal_signature(noisy, asked, template=template)
    true = mm.modal_signature(clean, asked, template=template)
    upper = make_basis(template, found.modes).triangle
    brought, lost = (
        (np.einsum("ij,tjd->tid", upper, a) ** 2).sum(axis=(0, 2))
        for a in (found.amplitudes - true.amplitudes, true.amplitudes)
    )
    beyond = (true.weighted_rms_errors**2).sum()
    counts = sorted({len(choose_modes(template, n).modes) for n in range(1, 201)} | {kept})
    risks = {n: beyond + brought[:n].sum() + lost[n:].sum() for n in counts}
    return float(np.sqrt(risks[kept] / min(risks.values())))


def deviations_of(
    clean: mm.MeshSequence, n_mixings: int, rng: np.random.Generator, n_draws: int = 60
) -> tuple[float, float, float]:
    """RMS deviation over frames, modes and directions: stated, true, true on a fixed template."""
    template = make_template(clean)
    fixed = mm.SignatureParameters(template=template.id)
    own, on_fixed, stated = [], [], []
    for draw in range(n_draws):
        noisy = with_noise(clean, 0.6, rng, mixed=n_mixings)
        made = mm.modal_signature(noisy, mm.SignatureParameters(deviations=draw < 4))
        own.append(made.amplitudes[1:])
        if n_mixings == 0:
            on_fixed.append(mm.modal_signature(noisy, fixed, template=template).amplitudes[1:])
        if made.amplitude_deviations is not None:
            stated.append(made.amplitude_deviations[1:])
    spreads = (np.std(each, axis=0, ddof=1) for each in (own, on_fixed or own))
    return (_rms(np.array(stated)), *(_rms(spread) for spread in spreads))  # type: ignore[return-value]


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))
