"""Files of results: what is written is what comes back, for any HDF5 program."""

from __future__ import annotations

import io
import os
import struct
import tracemalloc
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from store_samples import assert_same, sample_classification, sample_sequence, sample_signature

from modalmotion.classification.answer import Classification
from modalmotion.errors import StoreError
from modalmotion.hdf5.image import INTENDED_USE, contents_of
from modalmotion.mesh.alignment import Rotations
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence, mesh_sequence
from modalmotion.mesh.spring_modes import Modes, SpringModes
from modalmotion.modes import lowest_modes
from modalmotion.modes.topologies import CLOSED_CURVE, CUP, SPHERE, TORUS, Topology
from modalmotion.notes import Note
from modalmotion.signature.making import ModalSignature, SignatureParameters
from modalmotion.store import (
    classification_from_hdf5,
    classification_to_hdf5,
    sequence_from_hdf5,
    sequence_to_hdf5,
    signature_from_hdf5,
    signature_to_hdf5,
    template_from_hdf5,
    template_to_hdf5,
)
from modalmotion.template import GivenLandmarks, Landmarks, Template, make_template
from modalmotion.template.body_frame import Components

IDS = st.text("0123456789abcdef", min_size=64, max_size=64)
NUMBERS = st.floats(allow_subnormal=True)
UNITS = st.sampled_from([None, *MM_PER_UNIT])


@cache
def sample_image() -> bytes:
    return signature_to_hdf5(sample_signature(sample_sequence(1)))


def arrays(draw: Any, *shape: int) -> Any:
    return draw(hnp.arrays(np.float64, shape, elements=NUMBERS))


@st.composite
def signatures(draw: st.DrawFn) -> ModalSignature:
    topology: Topology = draw(st.sampled_from([CLOSED_CURVE, CUP, SPHERE, TORUS]))
    n_modes = draw(st.integers(1, 9))
    springs = SpringModes(arrays(draw, n_modes), draw(IDS))
    modes: Modes = lowest_modes(topology, n_modes)
    if draw(st.booleans()):
        modes = springs
    n_frames = draw(st.integers(1, 4))
    return ModalSignature(
        modes=modes,
        amplitudes=arrays(draw, n_frames, n_modes, 3),
        angular_frequencies=arrays(draw, n_modes),
        rotations=Rotations(arrays(draw, n_frames, 3, 3), draw(hnp.arrays(np.bool_, n_frames))),
        reference_amplitudes=arrays(draw, n_modes, 3),
        volumes=draw(st.none() | hnp.arrays(np.float64, n_frames, elements=NUMBERS)),
        translations=arrays(draw, n_frames, 3),
        rms_errors=arrays(draw, n_frames),
        weighted_rms_errors=arrays(draw, n_frames),
        p95_errors=arrays(draw, n_frames),
        max_errors=arrays(draw, n_frames),
        motion_rms=arrays(draw, n_frames),
        weighted_motion_rms=arrays(draw, n_frames),
        times=draw(st.none() | hnp.arrays(np.float64, n_frames, elements=NUMBERS)),
        amplitude_deviations=(arrays(draw, n_frames, n_modes, 3) if draw(st.booleans()) else None),
        unit=draw(UNITS),
        n_vertices=draw(st.integers(1, 2**40)),
        lengths=tuple(arrays(draw, topology.n_axes).tolist()),
        landmarks=draw(st.none() | landmarks()),
        condition=draw(NUMBERS),
        parameters=SignatureParameters(
            modes=draw(st.integers(1, 2000)),
            topology=draw(st.none() | st.text(max_size=9)),
            reference=draw(st.integers(0, 9)),
            remove_rotation=draw(st.booleans()),
            components=draw(st.sampled_from(Components)),
            landmarks=GivenLandmarks(
                apex=draw(st.none() | st.integers(0, 10**9)),
                base=draw(st.none() | st.tuples(*[st.floats(-1e9, 1e9)] * 3)),
                corners=draw(st.none() | st.tuples(*[st.integers(0, 99)] * 4)),
            ),
            template=draw(st.none() | IDS),
        ),
        sequence_id=draw(IDS),
        template_id=draw(IDS),
        notes=tuple(
            draw(st.lists(st.builds(Note, st.text(max_size=9), st.text(max_size=100)), max_size=3))
        ),
        provenance=draw(st.dictionaries(st.text(max_size=9), st.text(max_size=9), max_size=3)),
    )


@st.composite
def landmarks(draw: st.DrawFn) -> Landmarks:
    origin, axis, theta_zero, apex, base = (arrays(draw, 3) for _ in range(5))
    strengths = draw(st.dictionaries(st.sampled_from(["axis", "apex"]), st.floats(0, 1)))
    given_names = tuple(draw(st.lists(st.sampled_from(["axis", "base"]), max_size=2)))
    return Landmarks(
        origin,
        axis,
        theta_zero,
        apex,
        base,
        strengths=strengths,
        n_loops=draw(st.integers(0, 9)),
        given=given_names,
    )


@st.composite
def sequences(draw: st.DrawFn) -> MeshSequence:
    dtype = draw(st.sampled_from([np.float32, np.float64]))
    n_frames, n_vertices = draw(st.integers(1, 4)), draw(st.integers(1, 6))
    finite = st.floats(allow_nan=False, allow_infinity=False, width=32)
    n_faces = draw(st.integers(0, 3))
    return mesh_sequence(
        draw(hnp.arrays(dtype, (n_frames, n_vertices, 3), elements=finite)),
        draw(hnp.arrays(np.int64, (n_faces, 3), elements=st.integers(0, n_vertices - 1))),
        grid=draw(st.sampled_from([None, (n_vertices,)])),
        topology=draw(st.sampled_from([None, CLOSED_CURVE])),
        times=draw(st.sampled_from([None, np.arange(n_frames) / 7])),
        unit=draw(UNITS),
    )


@settings(max_examples=12 * int(os.environ.get("SOAK", "1")))
@given(signatures())
def test_a_signature_comes_back_bit_for_bit(signature: ModalSignature) -> None:
    image = signature_to_hdf5(signature)
    found = signature_from_hdf5(image)
    assert_same(found, signature)
    assert found.parameters.key == signature.parameters.key
    assert signature_to_hdf5(found) == image


@given(sequences())
def test_a_sequence_comes_back_bit_for_bit_and_with_its_id(sequence: MeshSequence) -> None:
    image = sequence_to_hdf5(sequence)
    found = sequence_from_hdf5(image)
    assert_same(found, sequence)
    assert found.id == sequence.id
    assert sequence_to_hdf5(found) == image


@given(
    st.lists(st.text(min_size=1), min_size=1, max_size=4, unique=True),
    st.data(),
)
def test_a_classification_comes_back_bit_for_bit(classes: list[str], data: Any) -> None:
    classification = replace(
        sample_classification("0" * 64),
        classes=tuple(classes),
        label=data.draw(st.sampled_from([None, *classes])),
        probabilities=data.draw(hnp.arrays(np.float64, len(classes), elements=NUMBERS)),
    )
    image = classification_to_hdf5(classification)
    assert_same(classification_from_hdf5(image), classification)


def test_a_template_comes_back_bit_for_bit() -> None:
    disc = np.array([[0.0, 0.0, 1.0], *([np.cos(a), np.sin(a), 0.0] for a in np.arange(6.0))])
    faces = [[0, i + 1, (i + 1) % 6 + 1] for i in range(6)]
    for sequence in (sample_sequence(1), mesh_sequence(disc[None], faces)):
        template = make_template(sequence)
        image = template_to_hdf5(template)
        assert_same(template_from_hdf5(image), template)
        assert template_to_hdf5(template_from_hdf5(image)) == image


def test_every_field_has_a_place_in_the_file() -> None:
    # A field that is added without one would come back as something else, or not at all.
    assert len(fields(ModalSignature)) == 27
    assert len(fields(SignatureParameters)) == 14
    assert len(fields(Landmarks)) == 8
    assert len(fields(GivenLandmarks)) == 4
    assert len(fields(SpringModes)) == 3
    assert len(fields(Rotations)) == 2
    # Its uncertainty is in the file of its track.
    assert len(fields(MeshSequence)) == 8
    assert len(fields(Classification)) == 12
    # How it was placed is of the recording that it was made from alone.
    assert len(fields(Template)) == 13


def test_a_file_on_disk_reads_like_its_bytes(tmp_path: Path) -> None:
    signature = sample_signature(sample_sequence(1))
    path = tmp_path / "a.h5"
    path.write_bytes(signature_to_hdf5(signature))
    assert_same(signature_from_hdf5(path), signature)


def test_any_hdf5_program_reads_the_file_and_learns_what_is_in_it(tmp_path: Path) -> None:
    sequence = sample_sequence(2)
    signature = sample_signature(sequence)
    classification = sample_classification(sequence.id)
    images = {
        "signature": signature_to_hdf5(signature),
        "sequence": sequence_to_hdf5(sequence),
        "classification": classification_to_hdf5(classification),
    }
    versions = {"signature": 7, "sequence": 2, "classification": 5}
    for kind, image in images.items():
        path = tmp_path / f"{kind}.h5"
        path.write_bytes(image)
        with h5py.File(path, "r") as file:
            assert file.attrs["schema"].decode() == f"modalmotion.{kind}"
            assert file.attrs["schema_version"] == versions[kind]
            assert file.attrs["kind"].decode() == kind
            assert file.attrs["intended_use"].decode() == INTENDED_USE
            assert file.attrs["sequence_id"].decode() == sequence.id
            for dataset in file.values():
                axes = [name for name in dataset.attrs["axes"].decode().split(", ") if name]
                assert len(axes) == dataset.ndim
                assert dataset.attrs["unit"].decode() in {"mm", "mm^2/s^2", "rad/s", "1", "none"}
    with h5py.File(tmp_path / "signature.h5", "r") as file:
        assert file["amplitudes"].attrs["axes"].decode() == "frame, mode, direction"
        np.testing.assert_array_equal(file["strain_energy"][:], signature.strain_energy)
        np.testing.assert_array_equal(
            file["deformation_spectrum"][:], signature.deformation_spectrum
        )


def test_an_unknown_unit_is_called_unknown(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(signature_to_hdf5(replace(sample_signature(sample_sequence(1)), unit=None)))
    with h5py.File(path, "r") as file:
        assert file["amplitudes"].attrs["unit"] == b"unknown"
    assert signature_from_hdf5(path).unit is None


def test_a_text_that_no_attribute_can_hold_is_refused_before_it_is_written() -> None:
    for model in ("a\x00b", "a\nb", "\ud800", "x" * 20_000):
        with pytest.raises(StoreError, match="model"):
            classification_to_hdf5(replace(sample_classification("1" * 64), model=model))


def test_attributes_that_unfold_are_refused_before_they_are_read() -> None:
    # A thousand texts of a megabyte each, all at one place: two gigabytes in one megabyte.
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        texts = ["a" * 1_000_000] + ["b"] * 999
        file.attrs.create("schema", texts, dtype=h5py.string_dtype())
    data, long, short = bytearray(buffer.getvalue()), *(struct.pack("<I", n) for n in (10**6, 1))
    at = data.find(long)
    while data[at + 16 : at + 20] != short:
        at = data.index(long, at + 1)
    data[at : at + 16_000] = bytes(data[at : at + 16]) * 1000
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="schema"):
            contents_of("a file", bytes(data))
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()
