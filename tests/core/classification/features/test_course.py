"""Measures of a recording beside its kind of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.classification.features.course import MEASURES, measures
from modalmotion.signature.making import ModalSignature, modal_signature
from modalmotion.simulate import Acquisition, simulate_ventricle


@pytest.fixture(scope="module")
def signature() -> ModalSignature:
    return modal_signature(simulate_ventricle(acquisition=Acquisition(n_frames=24)))


def measured(signature: ModalSignature) -> dict[str, float]:
    return dict(zip(MEASURES, measures(signature).tolist(), strict=True))


def test_the_size_is_in_mm_whatever_the_unit(signature: ModalSignature) -> None:
    beat = simulate_ventricle(acquisition=Acquisition(n_frames=24))
    metres = modal_signature(replace(beat, vertices=beat.vertices * 1e-3, unit="m"))
    assert measured(metres)["size"] == pytest.approx(measured(signature)["size"], abs=1e-6)
    assert np.exp(measured(signature)["size"]) == pytest.approx(
        np.sqrt(np.prod(signature.lengths)), rel=1e-9
    )


def test_a_longer_surface_is_more_elongated_however_it_is_turned(
    signature: ModalSignature,
) -> None:
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turned = replace(signature, reference_amplitudes=signature.reference_amplitudes @ turn)
    assert measured(turned)["elongation"] == pytest.approx(measured(signature)["elongation"])
    first, second, _ = np.linalg.svd(signature.reference_amplitudes, compute_uv=False)
    assert measured(signature)["elongation"] == pytest.approx(np.log(first / second))


def test_missing_frames_leave_a_gap_or_a_leap_and_repetition_counts(
    signature: ModalSignature,
) -> None:
    def part(frames: np.ndarray) -> dict[str, float]:
        return measured(replace(signature, amplitudes=signature.amplitudes[frames], times=None))

    whole = part(np.arange(24))
    assert part(np.arange(12))["gap"] > whole["gap"] + 1.0
    assert part(np.r_[:2, 10:24])["leap"] > whole["leap"] + 0.5
    assert whole["turns"] < 0.0 < 5.0 < part(np.r_[:24, :24])["turns"]
    # Anywhere that it starts.
    assert part(np.roll(np.arange(24), 7))["turns"] == pytest.approx(whole["turns"], abs=1e-9)


def test_what_a_recording_does_not_tell_is_not_a_number(signature: ModalSignature) -> None:
    still = replace(signature, amplitudes=np.zeros_like(signature.amplitudes))
    assert np.isnan([measured(still)[name] for name in ("gap", "leap", "turns")]).all()
    short = replace(signature, amplitudes=signature.amplitudes[:3], times=None)
    assert np.isnan(measured(short)["gap"])
    flat = replace(signature, reference_amplitudes=np.zeros((7, 3)))
    assert np.isnan(measured(flat)["elongation"])
