"""The kind of a signature: in its parameters, key and file, and never mixed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.errors import ParameterError
from modalmotion.signature import measure_tradeoff
from modalmotion.signature.distance import compare
from modalmotion.signature.hdf5 import signature_from_hdf5, signature_to_hdf5
from modalmotion.signature.making import SignatureKind, SignatureParameters, modal_signature
from modalmotion.signature.parameters import parameters_as_json, parameters_from_json
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle

BEAT = simulate_ventricle(
    VentricleParameters(shape_variation=2.0, motion_variation=1.0),
    grid=(12, 24),
    acquisition=Acquisition(n_frames=8),
    rng=np.random.default_rng(7),
)
ALONG_NORMALS = SignatureParameters(kind=SignatureKind.NORMAL_DISPLACEMENT)


def test_the_kind_is_part_of_the_key() -> None:
    assert SignatureParameters(kind=SignatureKind.MATERIAL).key == SignatureParameters().key
    assert ALONG_NORMALS.key != SignatureParameters().key
    assert parameters_from_json(parameters_as_json(ALONG_NORMALS)) == ALONG_NORMALS


def test_a_normal_displacement_is_one_amplitude_of_a_mode() -> None:
    signature = modal_signature(BEAT, ALONG_NORMALS)
    assert signature.kind == "normal_displacement"
    assert signature.amplitudes.shape == (8, 7, 1)
    assert signature.n_amplitudes == replace(ALONG_NORMALS, modes=None, amplitudes=7).modes == 7
    assert signature.compression == 3 * BEAT.n_vertices / 7
    assert signature.body_amplitudes is signature.amplitudes


def test_a_file_gives_it_back_bit_for_bit() -> None:
    signature = modal_signature(BEAT, ALONG_NORMALS)
    image = signature_to_hdf5(signature)
    again = signature_from_hdf5(image)
    assert again.amplitudes.tobytes() == signature.amplitudes.tobytes()
    assert again.kind == SignatureKind.NORMAL_DISPLACEMENT
    assert signature_to_hdf5(again) == image


def test_kinds_do_not_compare() -> None:
    a, b = modal_signature(BEAT, ALONG_NORMALS), modal_signature(BEAT)
    assert compare(a, a).distance == 0.0
    with pytest.raises(
        ParameterError, match="normal_displacement, the other of material"
    ) as caught:
        compare(a, b)
    assert "kind=normal_displacement" in str(caught.value.remedy)


@pytest.mark.parametrize(
    ("options", "named"), [({"components": "cylindrical"}, "components"), ({"auto": True}, "auto")]
)
def test_what_only_displacements_have_is_refused(options: dict[str, object], named: str) -> None:
    with pytest.raises(ParameterError, match=named) as caught:
        SignatureParameters(kind="normal_displacement", **options)  # type: ignore[arg-type]
    assert caught.value.remedy
    with pytest.raises(ParameterError, match="kind"):
        SignatureParameters(kind="sliding")  # type: ignore[arg-type]


@pytest.mark.parametrize("of", ["rms", "weighted_rms", "max"])
def test_a_tolerance_is_held_by_the_error_of_normal_displacements(of: str) -> None:
    limit = 1.2 if of == "max" else 0.4
    signature = modal_signature(
        BEAT,
        SignatureParameters(kind="normal_displacement", tolerance_of=of, tolerance=limit),  # type: ignore[arg-type]
    )
    assert signature.choice is not None
    error = {
        "rms": signature.rms_error,
        "weighted_rms": signature.weighted_rms_error,
        "max": signature.max_error,
    }[of]
    assert error <= signature.choice.limit
    assert len(signature.modes) > 1


def test_harmonics_are_those_of_any_signature() -> None:
    signature = modal_signature(
        BEAT,
        SignatureParameters(kind="normal_displacement", harmonics=2),  # type: ignore[arg-type]
    )
    assert signature.amplitudes.shape[2] == 1
    assert 0 < signature.rms_error < signature.motion_rms.max()


def test_the_trade_is_of_displacements() -> None:
    with pytest.raises(ParameterError, match="displacements") as caught:
        measure_tradeoff(BEAT, ALONG_NORMALS)
    assert "tolerance" in str(caught.value.remedy)
