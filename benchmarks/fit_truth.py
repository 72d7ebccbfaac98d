"""What a fit of noisy positions is worth, where the positions without noise are known."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np
from measure import medians
from mixed_noise import with_noise
from noisy_surfaces import (
    closed_body,
    drawn_noise,
    hull,
    individual,
    moving_body,
    moving_tube,
    smoothed,
)

import modalmotion as mm
from modalmotion.signature.fit import make_basis
from modalmotion.signature.parameters import ErrorKind
from modalmotion.template import choose_modes, make_template
from modalmotion.template.landmarks import GivenLandmarks


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
    counts = sorted({len(choose_modes(template, n)[0]) for n in range(1, 201)} | {kept})
    risks = {n: beyond + brought[:n].sum() + lost[n:].sum() for n in counts}
    return float(np.sqrt(risks[kept] / min(risks.values())))


def auto_of(rng: np.random.Generator, k: int) -> tuple[float, float, bool]:
    """Excess of `auto` on the k-th kind of surface; its noise over the true one; whether inside."""
    make = (individual, individual, individual, moving_body, moving_tube)[k % 5]
    clean = make(rng, n_frames=int(rng.choice([10, 16, 25, 40])))
    sigma, noisy = drawn_noise(clean, rng)
    made = mm.modal_signature(noisy, mm.SignatureParameters(auto=True))
    assert made.choice is not None
    noise = made.choice.noise
    assert noise is not None
    is_inside = noise.lowest <= sigma <= (noise.highest or 0.0)
    return excess_of(clean, noisy, len(made.modes)), noise.sigma / sigma, is_inside


def changed_kind(rng: np.random.Generator, noise: float) -> tuple[bool, bool]:
    """Whether noise changes the kind of modes of a closed body, and without a note on the border.

    Bodies are on both sides of the border between sphere and modes of the mesh, most near it.
    """
    x = closed_body(rng, bend=rng.uniform(0.0, 0.02))
    shapes = (x, x + rng.normal(0.0, noise, x.shape))
    one, other = (make_template(mm.mesh_sequence(y[None], hull(), unit="mm")) for y in shapes)
    changed = one.surface != other.surface
    return changed, changed and not all(
        "border" in " ".join(map(str, t.notes)) for t in (one, other)
    )


def deviations_of(
    clean: mm.MeshSequence, n_mixings: int, rng: np.random.Generator, is_marked: bool = False
) -> tuple[float, ...]:
    """RMS deviation over frames, modes and directions: stated, true, true on a fixed template.

    Of 60 draws; `is_marked` where the apex and a place with theta = 0 are stated.
    """
    template = make_template(clean)
    s, theta = template.coordinates.T
    places = np.argmin(s), np.argmin(np.abs(s - 0.5) + np.minimum(theta, 1 - theta))
    apex, zero = map(int, places) if is_marked else (None, None)
    marks = GivenLandmarks(apex=apex, theta_zero=zero)
    fixed = mm.SignatureParameters(template=template.id)
    own, on_fixed, stated = [], [], []
    for draw in range(60):
        noisy = with_noise(clean, 0.6, rng, mixed=n_mixings)
        made = mm.modal_signature(
            noisy, mm.SignatureParameters(deviations=draw < 4, landmarks=marks)
        )
        own.append(made.amplitudes[1:])
        if n_mixings == 0:
            on_fixed.append(mm.modal_signature(noisy, fixed, template=template).amplitudes[1:])
        if made.amplitude_deviations is not None:
            stated.append(made.amplitude_deviations[1:])
    spreads = (np.std(each, axis=0, ddof=1) for each in (own, on_fixed or own))
    return tuple(float(np.sqrt((x**2).mean())) for x in (np.array(stated), *spreads))


def times_of(heart: mm.MeshSequence, seed: int) -> list[float]:
    """Processor seconds of five fits: plain, with deviations, `auto`, of few vertices, refused."""
    fit, asked = mm.modal_signature, mm.SignatureParameters
    clean = individual(np.random.default_rng([seed, 0]), n_vertices=500)
    small = with_noise(clean, 0.5, np.random.default_rng([seed, 1]))

    def refuse() -> None:
        for kind in (ErrorKind.RMS, ErrorKind.MAX):
            with suppress(mm.ToleranceError):
                fit(small, asked(tolerance=1e-3, tolerance_of=kind))

    calls: dict[str, Callable[[], object]] = {
        "plain": partial(fit, heart),
        "deviations": partial(fit, heart, asked(deviations=True)),
        "auto": partial(fit, heart, asked(auto=True)),
        "small": partial(fit, small),
        "refusal": refuse,
    }
    return medians(calls, 5)


def pooled_deviations(seed: int) -> tuple[float, ...]:
    """Of five surfaces, 7 modes, 0.6 mm, on templates made from the noisy recording; 60 draws."""
    rng = np.random.default_rng([seed, 0])
    simulated = (make(rng) for make in (individual, moving_body, moving_tube))
    surfaces = [*map(smoothed, ("heart/lv_endocardium", "heart/epicardium")), *simulated]
    drawn = [[deviations_of(clean, n, rng) for clean in surfaces] for n in (0, 5)]
    # Each (kinds of noise, surfaces).
    stated, true, fixed = np.moveaxis(np.array(drawn), 2, 0)
    pooled = np.sqrt((stated**2).sum(axis=1) / (true**2).sum(axis=1))
    furthest = np.maximum(stated / true, true / stated)[0].max()
    marked = np.array([deviations_of(clean, 0, rng, is_marked=True) for clean in surfaces[:3]])
    of_marked = np.sqrt((marked[:, 0] ** 2).sum() / (marked[:, 1] ** 2).sum())
    return (*pooled, furthest, (true / fixed)[0].max(), of_marked)
