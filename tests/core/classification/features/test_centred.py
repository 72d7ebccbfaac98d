"""What readings about an axis share: one motion, over one turn, whichever modes are read of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.classification.features import FeatureReader, KnownFeatures
from modalmotion.classification.features.centred import CentredMotion, CentredMotions
from modalmotion.classification.features.temporal import Turns, harmonics, smooth_share
from modalmotion.signature.first_modes import first_modes
from modalmotion.signature.making import (
    ModalSignature,
    SignatureKind,
    SignatureParameters,
    modal_signature,
)
from modalmotion.simulate import Acquisition, simulate_ventricle

BEAT = simulate_ventricle(
    grid=(12, 24),
    acquisition=Acquisition(n_frames=16, noise=0.3),
    rng=np.random.default_rng(4),
)


def of_beat(kind: str = "material") -> ModalSignature:
    return modal_signature(BEAT, SignatureParameters(modes=16, kind=SignatureKind(kind)))


@pytest.fixture(scope="module", params=["material", "offset"])
def signature(request: pytest.FixtureRequest) -> ModalSignature:
    return of_beat(request.param)


def test_harmonics_size_and_smoothness_are_those_of_the_modes(signature: ModalSignature) -> None:
    motion = CentredMotion(Turns(signature).of_first())
    a = 100.0 * signature.amplitudes / np.sqrt(np.prod(signature.lengths))
    a = a - a.mean(axis=0)
    assert motion.amplitudes == pytest.approx(a, abs=1e-9)
    flat = a[:, 2:9].reshape(len(a), -1)
    n = a.shape[2]
    cosines, sines = motion.harmonic_rows(2)[:, 2 * n : 9 * n].reshape(2, 2, -1)
    assert cosines + 1j * sines == pytest.approx(harmonics(motion.share, flat, 2), abs=1e-9)
    every = motion.amplitudes.reshape(len(a), -1)
    assert motion.products == pytest.approx(every.T @ every, rel=1e-9)
    some = np.repeat([0.0, 1.0], [2 * n, 7 * n])
    assert motion.amount(some)[0] == pytest.approx(np.sqrt((flat**2).sum() / len(a)) / 100.0)
    expected = smooth_share(motion.share, flat, is_cycle=True)
    assert motion.amount(some)[1] == pytest.approx(expected, abs=1e-12)
    assert 0.5 < expected < 1.0


def test_readers_of_fewer_modes_read_what_is_known_as_if_they_were_alone(
    signature: ModalSignature,
) -> None:
    known = KnownFeatures()
    for n_modes in (16, 7, 13, 7):
        reader = FeatureReader(True, True, 2, False, n_modes=n_modes)
        after = reader.read(signature, known)
        alone = FeatureReader(True, True, 2, False).read(first_modes(signature, n_modes))
        assert after.columns == alone.columns
        assert after.values == pytest.approx(alone.values, abs=1e-9)
        assert after.motion == pytest.approx(alone.motion)
        assert after.smooth_share == pytest.approx(alone.smooth_share)
    assert len(known.features) == 3


def test_the_modes_that_are_read_say_whether_the_last_frame_is_the_first() -> None:
    signature = of_beat()
    a = np.concatenate([signature.amplitudes, signature.amplitudes[:1]])
    # From mode 9 on it does not come back.
    a[-1, 9:] += 0.5 * np.ptp(a[:, 9:], axis=0)
    longer = replace(signature, amplitudes=a, times=None)
    motions = CentredMotions(longer)
    assert [len(motions.of_first(n).share) for n in (7, 9, 10, 16)] == [16, 16, 17, 17]
    assert motions.of_first(7) is motions.of_first(9)
