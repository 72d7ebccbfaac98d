"""Values of another kind than a function takes are refused by their name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.arguments.checking import one_of, real, truth, whole, whole_numbers
from modalmotion.codec import encode
from modalmotion.modes import whole_count
from modalmotion.signature import measure_tradeoff
from modalmotion.signature.parameters import ErrorKind

P: Any = mm.SignatureParameters
MAKE: Any = mm.make_template
LATTICE: Any = mm.Lattice
LOWEST: Any = mm.lowest_modes


def small() -> mm.MeshSequence:
    return mm.mesh_sequence(
        np.random.default_rng(0).normal(size=(3, 24, 3)), grid=(4, 6), topology="cup"
    )


REFUSED: dict[str, Callable[[], object]] = {
    "modes is 7.5": lambda: P(modes=7.5),
    "modes is True": lambda: P(modes=True),
    "amplitudes is 20.5": lambda: P(amplitudes=20.5),
    "harmonics is 1.5": lambda: P(harmonics=1.5),
    "reference is True": lambda: P(reference=True),
    "reference is 1.5": lambda: P(reference=1.5),
    "reference is 'first'": lambda: P(reference="first"),
    "tolerance is '2'": lambda: P(tolerance="2"),
    "tolerance is True": lambda: P(tolerance=True),
    "auto is 1": lambda: P(auto=1),
    "tolerance_of is 'mean'": lambda: P(tolerance=1.0, tolerance_of="mean"),
    "topology is 5": lambda: P(topology=5),
    "landmarks is 5": lambda: P(landmarks=5),
    r"shape is \(2.7, 4\)": lambda: LATTICE(mm.PLANE, (2.7, 4)),
    "stiffness, one number or a tuple": lambda: LATTICE(mm.PLANE, (4, 4), stiffness=[1, 2]),
    "for each axis, is 'x'": lambda: LATTICE(mm.PLANE, (4, 4), stiffness=(1.0, "x")),
    "mass is True": lambda: LATTICE(mm.PLANE, (4, 4), mass=True),
    "n_modes is 7.5": lambda: LOWEST(mm.CUP, 7.5),
    "n_modes is True": lambda: whole_count(mm.CUP, True),
    "n_bytes is 2000.5": lambda: encode(small(), n_bytes=2000.5),  # type: ignore[arg-type]
    "'rms' of encode.. is a str": lambda: encode(small(), rms="a"),  # type: ignore[arg-type]
    "n_frames is 2.5": lambda: mm.Acquisition(n_frames=2.5),  # type: ignore[arg-type]
    "length is '8'": lambda: mm.VentricleParameters(length="8"),  # type: ignore[arg-type]
    "n_vertices is 90.5": lambda: mm.simulate_ventricle(
        n_vertices=90.5,  # type: ignore[arg-type]
        rng=np.random.default_rng(0),
    ),
    "reference is frame 1.5": lambda: MAKE(small(), reference=1.5),
    "reference is frame True": lambda: MAKE(small(), reference=True),
    "most_modes is 9.0": lambda: measure_tradeoff(small(), most_modes=9.0).front,  # type: ignore[arg-type]
}


@pytest.mark.parametrize("words", REFUSED)
def test_another_kind_is_refused_by_name(words: str) -> None:
    with pytest.raises(mm.ParameterError, match=words) as refused:
        REFUSED[words]()
    assert refused.value.remedy


def test_what_is_meant_is_taken() -> None:
    assert P(topology=mm.CUP).topology == "cup"
    assert P(tolerance=1, tolerance_of="max").tolerance_of is ErrorKind.MAX
    for name, value in (("modes", np.int64(9)), ("reference", np.int32(2))):
        taken = P(**{name: value})
        assert taken.key == P(**{name: int(value)}).key
        assert type(getattr(taken, name)) is int
    assert P(reference="mean").reference == "mean"


def test_kinds() -> None:
    assert whole("n", np.uint8(7)) == 7
    assert whole_numbers("n", [np.int64(2), 3]) == (2, 3)
    assert real("x", np.float32(1.5)) == 1.5
    assert truth("x", np.True_) is True
    assert one_of("x", "rms", ErrorKind) is ErrorKind.RMS
