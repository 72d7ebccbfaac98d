"""Every public value goes to another process and comes back as it was."""

from __future__ import annotations

import copy
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from classify_samples import small_model

import modalmotion as mm
from modalmotion.arguments.checking import FrozenArrays
from modalmotion.classification import TrainingCase, TrainingOptions, classify

FACTS = mm.Facts(period=2.0, landmarks={"apex": 3}, covariates={"age": 61, "sex": "f"})


@cache
def values() -> dict[str, Any]:
    acquisition = mm.Acquisition(n_frames=5)
    mesh = mm.simulate_ventricle(
        n_vertices=150, acquisition=acquisition, rng=np.random.default_rng(1)
    ).with_facts(FACTS)
    lattice = mm.simulate_ventricle(grid=(6, 12), acquisition=acquisition)
    signature = mm.modal_signature(mesh)
    springs = mm.SignatureParameters(topology="mesh")
    chosen = mm.SignatureParameters(modes=None, auto=True)
    return {
        "sequence": mesh,
        "lattice sequence": lattice,
        "signature": signature,
        "signature of a lattice": mm.modal_signature(lattice),
        "signature in spring modes": mm.modal_signature(mesh, springs),
        "signature down to the noise": mm.modal_signature(mesh, chosen),
        "modes": signature.modes,
        "template": mm.make_template(mesh),
        "facts": FACTS,
        "parameters": signature.parameters,
        "readouts": mm.clinical_readouts(signature, mesh),
        "topology": mm.CUP,
        "model": small_model(),
        "card": small_model().card,
        "classification": classify(signature, small_model()),
        "case": TrainingCase(signature, "rest", "P 1"),
        "options": TrainingOptions(repetitions=2),
    }


NAMES = (
    *("sequence", "lattice sequence", "signature", "signature of a lattice"),
    *("signature in spring modes", "signature down to the noise", "modes", "template", "facts"),
    *("parameters", "readouts", "topology", "model", "card", "classification", "case", "options"),
)


def pickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))  # noqa: S301 (our own)


def require_same(one: Any, other: Any) -> None:
    """Check that two values are the same to the last bit, and their arrays as writable."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    elif is_dataclass(one):
        # How a template was placed is not kept in files, and is made of functions.
        for field in (field for field in fields(one) if field.name != "placement"):
            mine, its = getattr(one, field.name), getattr(other, field.name)
            require_same(mine, its)
            if isinstance(one, FrozenArrays) and isinstance(mine, np.ndarray):
                assert not mine.flags.writeable
                assert not its.flags.writeable
    elif isinstance(one, tuple):
        assert len(one) == len(other)
        for mine, its in zip(one, other, strict=True):
            require_same(mine, its)
    else:
        assert one == other


def test_all_of_them_are_tested() -> None:
    assert set(NAMES) == set(values())


@pytest.mark.parametrize("copied", [pickled, copy.deepcopy, copy.copy])
@pytest.mark.parametrize("name", NAMES)
def test_a_copy_is_the_same(name: str, copied: Callable[[Any], Any]) -> None:
    value = values()[name]
    # Also after everything that a value keeps once it is known.
    for attribute in ("id", "_hash"):
        getattr(value, attribute, None)
    other = copied(value)
    require_same(value, other)
    assert repr(other) == repr(value)


def test_modes_from_another_process_are_found_by_their_hash() -> None:
    """Hashes of texts differ between processes, so none may travel along."""
    code = (
        "import pickle, sys\n"
        "from modalmotion import CUP, lowest_modes\n"
        "modes = lowest_modes(CUP, 7, (6, 12))\n"
        "hash(modes)\n"
        "sys.stdout.buffer.write(pickle.dumps(modes))\n"
    )
    there = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONHASHSEED": "77"},
        capture_output=True,
        check=True,
    )
    modes = pickle.loads(there.stdout)  # noqa: S301 (our own)
    own = mm.lowest_modes(mm.CUP, 7, (6, 12))
    assert {own: "there"}[modes] == "there"


def test_errors_come_back_with_what_they_say() -> None:
    with pytest.raises(mm.ModeCountError) as caught:
        mm.modal_signature(values()["sequence"], mm.SignatureParameters(modes=100_000))
    error = pickled(caught.value)
    assert (str(error), error.remedy, error.details, error.code) == (
        str(caught.value),
        caught.value.remedy,
        caught.value.details,
        caught.value.code,
    )
