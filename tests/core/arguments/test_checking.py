"""Whatever is given to a public function in place of what it takes, the error is one of ours."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any, Final

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.errors import ModalMotionError
from modalmotion.mesh import face_areas
from modalmotion.progress import Progress

ROOT: Final = Path(mm.__file__).parent
# The command line, and numbers that models read, which have no user.
LEFT_OUT: Final = ("modalmotion.cli",)


def packages() -> Iterator[str]:
    for path in sorted(ROOT.rglob("__init__.py")):
        name = ".".join(["modalmotion", *path.parent.relative_to(ROOT).parts])
        if "__all__" in path.read_text() and name not in LEFT_OUT:
            yield name


@cache
def public_functions() -> dict[str, Callable[..., Any]]:
    """Every function of a public list, by its name."""
    return {
        f"{package}.{name}": value
        for package in packages()
        for name in import_module(package).__all__
        if isinstance(value := getattr(import_module(package), name), FunctionType)
    }


@cache
def beat() -> mm.MeshSequence:
    return mm.simulate_ventricle(
        grid=(8, 12), acquisition=mm.Acquisition(n_frames=4), rng=np.random.default_rng(1)
    )


@cache
def wrong() -> dict[str, Any]:
    return {
        "a word": "no such thing",
        "an array": np.zeros((4, 96, 3)),
        "nothing": None,
        "a list": [],
        "a list of things": [object(), object()],
        "a number": 7,
        "a signature": mm.modal_signature(beat(), mm.SignatureParameters(modes=3)),
        "a thing": object(),
    }


def needs(function: Callable[..., Any], given: object) -> tuple[list[object], dict[str, object]]:
    """Give one thing for all that a function needs, and for the first if it needs nothing."""
    taken = inspect.signature(function).parameters.values()
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    plain = [p for p in taken if p.kind in kinds]
    needed = [p for p in plain if p.default is p.empty] or plain[:1]
    named = [p for p in taken if p.kind is p.KEYWORD_ONLY and p.default is p.empty]
    return [given for _ in needed], {p.name: given for p in named}


@pytest.mark.parametrize("name", public_functions())
def test_what_is_wrong_is_told_by_an_error_of_ours(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for given in wrong().values():
        args, kwargs = needs(public_functions()[name], given)
        # What is right by chance, such as a word for a word, is no error.
        with suppress(ModalMotionError):
            public_functions()[name](*args, **kwargs)


BEAT: Final = "mesh_sequence(vertices, faces)"


@pytest.mark.parametrize(
    ("attempt", "remedy"),
    [
        (lambda: mm.modal_signature(7), BEAT),  # type: ignore[arg-type]
        (lambda: mm.modal_signature(np.zeros(4)), BEAT),  # type: ignore[arg-type]
        (lambda: mm.modal_signature(beat(), node=7), "modal_signature(sequence, parameters=None"),  # type: ignore[call-arg]
        (lambda: mm.modal_signature(beat(), "7"), "Give a SignatureParameters"),  # type: ignore[arg-type]
        (lambda: mm.modal_signature(beat(), mode=7), "Did you mean modes?"),  # type: ignore[call-arg]
        (lambda: mm.train([beat()], "mine"), "path, label and subject"),  # type: ignore[list-item]
        (lambda: beat().report(7), "Name a file"),
        (lambda: mm.classify({}), "modal_signature(sequence)"),  # type: ignore[arg-type]
        (lambda: mm.to_html(object()), "sequence.signature()"),  # type: ignore[arg-type]
        (lambda: mm.mesh_sequence(None), "float32 or float64 coordinates"),
        (lambda: mm.read("there is none.npz"), "Name a file"),
        (lambda: mm.read_images("there is none.nii.gz"), "NIfTI"),  # type: ignore[arg-type]
        (lambda: mm.track("there is none"), "zip or folder"),
        (lambda: mm.track([np.zeros((9, 3))], mode=7), "landmarks"),
        (lambda: mm.track([np.eye(3)], landmarks={"apex": "x"}), 'Write {"apex": [x, y, z]'),
        (lambda: mm.save(beat(), "beat.xyz"), ".vtkhdf"),
        (lambda: mm.plot(3), "read(path)"),
        (lambda: face_areas(np.zeros((3, 3)), np.zeros((1, 3))), "array of whole numbers"),  # type: ignore[arg-type]
        (lambda: mm.read_sequence(7), "Name a file"),  # type: ignore[arg-type]
    ],
)
def test_first_guesses_are_told_what_to_write(attempt: Callable[[], Any], remedy: str) -> None:
    with pytest.raises(ModalMotionError) as caught:
        attempt()
    assert remedy in caught.value.remedy


def test_a_mistake_within_is_not_the_users() -> None:
    def progress(_: Progress) -> None:
        raise TypeError("progress() got an unexpected keyword argument 'total'")

    with pytest.raises(TypeError, match="'total'"):
        mm.track([*beat().vertices.astype(float)], unit="mm", modes=4, progress=progress)


def test_what_is_clear_is_taken_as_it_is_meant(tmp_path: Path) -> None:
    path = beat().save(tmp_path / "beat.npz")
    own = mm.modal_signature(beat(), mm.SignatureParameters(modes=4))
    for motion in (beat(), mm.read_sequence(str(path)), path, str(path)):
        for made in (mm.modal_signature(motion, 4), mm.modal_signature(motion, modes=4)):  # type: ignore[arg-type,call-arg]
            assert made.rms_error == own.rms_error
    assert mm.classify(mm.read_sequence(path), coverage=0.8).coverage == 0.8  # type: ignore[arg-type]
    assert mm.read_sequence(path, frame_interval=0.1).sequence.times is not None  # type: ignore[call-arg]
    assert mm.to_html(beat()) == mm.to_html(beat().signature())  # type: ignore[arg-type]
    assert mm.decode(beat().encode(max_error=0.1)).n_frames == 4  # type: ignore[arg-type]


def test_first_guesses_of_names_are_right(tmp_path: Path) -> None:
    motion = mm.simulate_ventricle()
    readouts, strain = motion.readouts(), motion.strain()
    volumes = motion.volumes
    assert volumes.max() == readouts.mesh_curve.end_diastolic_volume
    share = 100 * (1 - volumes.min() / volumes.max())
    assert readouts.ejection_fraction == pytest.approx(share, abs=0.5)
    figures = (strain.gls, strain.gcs, strain.gas)
    assert figures == tuple(strain.end_systolic[name] for name in ("GLS", "GCS", "GAS"))
    signature = motion.signature(modes=4)
    files = motion.save(tmp_path / "beat.npz"), signature.save(tmp_path / "beat.h5")
    for path, value in zip(files, (motion, signature), strict=True):
        names = [one.get_title() for one in mm.plot(str(path)).axes]
        assert names == [one.get_title() for one in mm.plot(value).axes]


def test_a_path_is_classified_as_the_sequence_in_it_is(tmp_path: Path) -> None:
    # No tracking is stated, so a model of normal displacements reads it: a signature with the usual
    # parameters would be one of another kind.
    still = mm.simulate_ventricle()
    sequence = mm.mesh_sequence(still.vertices, still.faces, unit="mm")
    (tmp_path / "beat.npz").write_bytes(mm.write_npz(sequence))
    found = mm.classify(str(tmp_path / "beat.npz"))  # type: ignore[arg-type]
    assert found.flags == ()
    assert (found.label, found.model) == (sequence.classify().label, sequence.classify().model)


def test_an_array_is_a_sequence_without_faces(tmp_path: Path) -> None:
    # A ring of points is a curve; of a surface the error asks for its faces.
    at = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.stack([np.stack([np.cos(at), r * np.sin(at), 0 * at], axis=1) for r in (1, 1.1)])
    signature = mm.modal_signature(ring, topology="closed curve")  # type: ignore[arg-type,call-arg]
    assert signature.n_vertices == 12
    for ask in (mm.modal_signature, mm.classify):
        with pytest.raises(ModalMotionError, match="faces"):
            ask(beat().vertices)  # type: ignore[arg-type]


def test_an_error_within_is_not_hidden_and_a_door_is_the_function() -> None:
    again = pickle.loads(pickle.dumps(mm.modal_signature))  # noqa: S301 (our own bytes)
    assert again is mm.modal_signature
    assert inspect.signature(mm.modal_signature).parameters.keys() >= {"sequence", "parameters"}
    assert mm.modal_signature.__doc__
    assert mm.modal_signature.__name__ == "modal_signature"
