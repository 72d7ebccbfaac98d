"""Twins by signs against the same features read from a motion that is altered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.classification.features import FeatureReader
from modalmotion.classification.features.hand import mirrored, theta_is_of_the_shape
from modalmotion.classification.features.twins import TWINS, of_kinds, twin_signs
from modalmotion.signature.making import (
    ModalSignature,
    SignatureKind,
    SignatureParameters,
    modal_signature,
)
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle

READERS = {
    "axis": FeatureReader(True, True, 2, False),
    "axis, walls": FeatureReader(True, True, 2, True),
    "modes, cycle": FeatureReader(False, True, 2, False),
    "modes, walls": FeatureReader(False, True, 2, True),
    "modes, course": FeatureReader(False, False, 2, False),
    "few, course": FeatureReader(False, False, 2, False, is_brief=True),
}


CASES = [(n, kind) for n in (None, 500) for kind in SignatureKind]


@pytest.fixture(scope="module", params=CASES, ids=str)
def signature(request: pytest.FixtureRequest) -> ModalSignature:
    rng = np.random.default_rng(3)
    beat = simulate_ventricle(
        draw_parameters(MotionClass.DYSSYNCHRONY, rng),
        n_vertices=request.param[0],
        acquisition=Acquisition(n_frames=20, noise=0.3),
        rng=rng,
    )
    return modal_signature(
        beat, SignatureParameters(modes=7, reference="mean", kind=request.param[1])
    )


@pytest.mark.every(4)
@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize("twin", TWINS)
def test_a_twin_is_what_the_altered_motion_reads_as(
    signature: ModalSignature, name: str, twin: str
) -> None:
    reader = READERS[name]
    own = reader.read(signature)
    turns = theta_is_of_the_shape(signature)
    signs = twin_signs(own.columns, mirror_turns_theta=turns)[TWINS.index(twin)]
    a = signature.amplitudes
    altered = {
        "mirrored": mirrored(signature),
        "reversed": replace(signature, amplitudes=a[::-1]),
        "inverted": replace(signature, amplitudes=2 * a.mean(axis=0) - a),
    }[twin]
    read = reader.read(altered).values
    apart = np.abs(read - own.values[0] * signs).max(axis=1) / np.abs(own.values).max()
    # About an axis in one of its readings.
    assert apart.min() < 1e-9


def test_the_amount_of_motion_has_no_sign() -> None:
    assert of_kinds(-np.ones((3, 2))).tolist() == [[-1.0, -1.0, 1.0]] * 3
