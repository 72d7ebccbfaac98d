"""Remedies are followed to the letter, and what follows succeeds."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner
from remedy_sentences import named_in, remedies, sentences
from template_surfaces import MAKERS, Moving

from modalmotion.classification import TrainingCase, TrainingOptions, train
from modalmotion.cli import main
from modalmotion.clinical import clinical_readouts
from modalmotion.codec import decode, encode
from modalmotion.errors import ModalMotionError
from modalmotion.formats import ReadOptions, read_sequence, write_npz, write_raw
from modalmotion.formats.named_arrays import read_raw
from modalmotion.mesh import Facts, facts_from_texts
from modalmotion.mesh.sequence import MEAN, MeshSequence, mesh_sequence
from modalmotion.modes.lattice import modes_named
from modalmotion.modes.topologies import CUP, parse_label
from modalmotion.signature.distance import compare
from modalmotion.signature.making import (
    ModalSignature,
    SignatureKind,
    SignatureParameters,
    modal_signature,
)
from modalmotion.template import GivenLandmarks, make_template
from modalmotion.template.body_frame import Components
from modalmotion.template.vibration_modes import surface_modes
from modalmotion.tracking.reading import read_observed

Way = Callable[[], object]


def moving(topology: str = "cup", n: int = 120) -> Moving:
    return MAKERS[topology](n, np.random.default_rng(6))


def surface(topology: str = "cup", n: int = 120, **stated: Any) -> MeshSequence:
    return mesh_sequence(*moving(topology, n), **{"unit": "mm", **stated})


def fitted(sequence: MeshSequence | None = None, **parameters: Any) -> ModalSignature:
    sequence = surface() if sequence is None else sequence
    return modal_signature(sequence, SignatureParameters(**parameters))


def remedy_of(way: Way) -> str:
    with pytest.raises(ModalMotionError) as caught:
        way()
    assert caught.value.remedy
    return caught.value.remedy


def number_in(text: str, after: str) -> float:
    match = re.search(rf"{after} (\d[\d.e+-]*\d|\d)", text)
    assert match is not None, text
    return float(match[1])


@dataclass(frozen=True)
class Try:
    """An error, and everything that its remedy says to do instead.

    Parameters
    ----------
    remedy : str
        A part of it, which names no value.
    wrong : callable
        Raises it.
    right : tuple of callable
        Take the remedy's text, for the numbers in it.
    """

    remedy: str
    wrong: Way
    right: tuple[Callable[[str], object], ...]


FINS = mesh_sequence(
    np.random.default_rng(5).normal(size=(3, 5, 3)), [[0, 1, 2], [0, 1, 3], [0, 1, 4]], unit="mm"
)
LATTICE = surface().vertices[:, :60]
LINE = np.cumsum(np.random.default_rng(2).random((4, 9, 3)), axis=1)


def two_pieces() -> Moving:
    vertices, faces = moving()
    both = np.concatenate([vertices, vertices + 100.0], axis=1)
    return both, np.concatenate([faces, faces + vertices.shape[1]])


PIECES = two_pieces()


def without_unit(**parameters: Any) -> ModalSignature:
    return fitted(surface(unit=None), **parameters)


def with_landmarks(topology: str = "cup", **places: Any) -> object:
    return make_template(surface(topology), landmarks=GivenLandmarks(**places))


def lowest_and_highest() -> tuple[int, int]:
    height = moving()[0][0, :, 2]
    return int(height.argmin()), int(height.argmax())


def sized(scale: float) -> object:
    vertices, faces = moving()
    sequence = mesh_sequence(vertices * scale, faces)
    return clinical_readouts(modal_signature(sequence), sequence)


def springs(**parameters: Any) -> ModalSignature:
    return fitted(surface(), **{"topology": "mesh", **parameters})


@cache
def of_balls(seed: int = 0, *, as_sequences: bool = False) -> list[TrainingCase]:
    """Small spheres that grow, or do not."""
    rng = np.random.default_rng(seed)
    cases = []
    for number in range(12):
        vertices, faces = MAKERS["sphere"](50, rng)
        grown = vertices[:1] * (1 + 0.1 * (number % 2) * np.arange(6)[:, None, None])
        moved = mesh_sequence(grown + 0.05 * rng.normal(size=grown.shape), faces, unit="mm")
        cases.append(
            TrainingCase(moved if as_sequences else fitted(moved), f"{number % 2}", f"{number}")
        )
    return cases


BEATS = [
    case.motion for case in of_balls(as_sequences=True) if isinstance(case.motion, MeshSequence)
]


def with_one(text: str, place: int) -> object:
    """The template of a cup with one of the landmarks that a remedy names."""
    names = re.findall(r"[a-z_]+", text.removeprefix("Give "))
    vertex = lowest_and_highest()[1]
    return make_template(surface(), landmarks=GivenLandmarks.from_json({names[place]: vertex}))


def on_lattice(topology: str) -> ModalSignature:
    return modal_signature(mesh_sequence(LATTICE, grid=(6, 10), topology=topology))


QUICK = TrainingOptions(repetitions=1)

TRIED = (
    Try(
        "Fit it with `fitted`.",
        lambda: TrainingCase(surface(), "0").signature,
        (lambda _: TrainingCase(surface(), "0").fitted(SignatureParameters()).signature,),
    ),
    Try(
        "Set the unit: m, cm, mm, um or nm.",
        lambda: without_unit(tolerance=1.0),
        (lambda _: fitted(tolerance=3.0),),
    ),
    Try(
        "Set one of modes, amplitudes, tolerance and auto.",
        lambda: fitted(modes=4, tolerance=3.0),
        (
            lambda _: fitted(modes=4),
            lambda _: fitted(amplitudes=12),
            lambda _: fitted(tolerance=3.0),
            lambda _: fitted(auto=True),
        ),
    ),
    Try(
        "Allow a tolerance of",
        lambda: fitted(surface(n=30), tolerance=1e-5),
        (lambda text: fitted(surface(n=30), tolerance=number_in(text, "a tolerance of")),),
    ),
    Try(
        "Ask for at most … modes, or send a finer mesh.",
        lambda: fitted(surface(n=30), modes=70),
        (
            lambda text: fitted(surface(n=30), modes=int(number_in(text, "at most"))),
            lambda _: fitted(surface(n=400), modes=70),
        ),
    ),
    Try(
        "Ask for at most … modes.",
        lambda: surface_modes(make_template(surface(n=25)), 60),
        (lambda text: surface_modes(make_template(surface(n=25)), int(number_in(text, "most"))),),
    ),
    Try(
        "Ask for 1 to … modes.",
        lambda: fitted(FINS),
        (lambda text: fitted(FINS, modes=int(number_in(text, "1 to"))),),
    ),
    Try(
        "Ask for at most …, or do not limit the harmonics.",
        lambda: fitted(harmonics=40),
        (lambda text: fitted(harmonics=int(number_in(text, "at most"))), lambda _: fitted()),
    ),
    Try(
        "Set which ends are joined: topology = cup, cylinder",
        lambda: modal_signature(mesh_sequence(LATTICE, grid=(6, 10))),
        (lambda _: [on_lattice(t) for t in ("cup", "cylinder", "plane", "torus", "sphere")],),
    ),
    Try(
        "Send triangles, or the lattice as grid and topology, or set the topology to open curve",
        lambda: modal_signature(mesh_sequence(LINE)),
        (
            lambda _: fitted(),
            lambda _: modal_signature(mesh_sequence(LATTICE, grid=(6, 10), topology="plane")),
            lambda _: fitted(mesh_sequence(LINE, topology="open curve"), modes=4),
            lambda _: fitted(mesh_sequence(LINE), modes=5, topology="closed curve"),
        ),
    ),
    Try(
        "State …, or leave the topology out.",
        lambda: fitted(topology="sphere"),
        (
            lambda text: [fitted(topology=t) for t in text.split(",")[0][6:].split(" or ")],
            lambda _: fitted(),
        ),
    ),
    Try(
        "Leave the topology out: the mesh then gets the spring modes of its own connectivity.",
        lambda: fitted(mesh_sequence(*PIECES), topology="cup"),
        (lambda _: fitted(mesh_sequence(*PIECES)),),
    ),
    Try(
        "Give two places at opposite ends of the surface.",
        lambda: with_landmarks(apex=3, base=3),
        (lambda _: with_landmarks(apex=lowest_and_highest()[0], base=lowest_and_highest()[1]),),
    ),
    Try(
        "Give a place on the wall, away from apex and axis.",
        lambda: with_landmarks(theta_zero=3, apex=3),
        (lambda _: with_landmarks(theta_zero=lowest_and_highest()[1], apex=3),),
    ),
    Try(
        "Give ….",
        lambda: with_landmarks(corners=(1, 2, 3, 4)),
        (lambda text: with_one(text, 0), lambda text: with_one(text, 2)),
    ),
    Try(
        "Leave the landmarks out.",
        lambda: make_template(FINS, landmarks=GivenLandmarks(apex=1)),
        (lambda _: make_template(FINS),),
    ),
    Try(
        "Ask for Cartesian components.",
        lambda: fitted(FINS, modes=3, components=Components.CYLINDRICAL),
        (lambda _: fitted(FINS, modes=3, components=Components.CARTESIAN),),
    ),
    Try(
        "Name a frame of the sequence, counted from 0, or",
        lambda: fitted(reference=99),
        (lambda _: fitted(reference=11), lambda _: fitted(reference=MEAN)),
    ),
    Try(
        "Send the wall of a cavity, or state its topology (cup) if this is one.",
        lambda: clinical_readouts(fitted(surface("plane"), topology="plane"), surface("plane")),
        (
            lambda _: clinical_readouts(fitted(), surface()),
            lambda _: clinical_readouts(fitted(surface("plane"), topology="cup"), surface("plane")),
        ),
    ),
    Try(
        "Use a larger or smaller unit, with numbers near 1.",
        lambda: sized(1e-150),
        (lambda _: sized(1e-2),),
    ),
    Try(
        "Give the unit of the sequence; the ejection fraction needs none.",
        lambda: clinical_readouts(without_unit(), surface(unit=None)).millilitres,
        (
            lambda _: clinical_readouts(fitted(), surface()).millilitres,
            lambda _: clinical_readouts(without_unit(), surface(unit=None)).curve.share_bound,
        ),
    ),
    Try(
        "Write the coordinates in a larger unit, or ask for a format in double precision (npz).",
        lambda: write_raw(mesh_sequence(moving()[0] * 1e60, moving()[1])),
        (
            lambda _: write_raw(mesh_sequence(moving()[0] * 1e60 * 1e-60, moving()[1])),
            lambda _: write_npz(mesh_sequence(moving()[0] * 1e60, moving()[1])),
        ),
    ),
    Try(
        "Fit both with the same number of modes, topology and components.",
        lambda: compare(fitted(modes=4), fitted(modes=7)),
        (lambda _: compare(fitted(modes=4), fitted(modes=4)),),
    ),
    Try(
        "Set the unit of both.",
        lambda: compare(fitted(), without_unit()),
        (lambda _: compare(fitted(), fitted()),),
    ),
    Try(
        "Set one of rms, max_error and bytes (in Python n_bytes).",
        lambda: encode(surface(n=40), rms=1.0, max_error=1.0),
        (
            lambda _: encode(surface(n=40), rms=1.0, effort="fast"),
            lambda _: encode(surface(n=40), max_error=1.0, effort="fast"),
            lambda _: encode(surface(n=40), n_bytes=6000, effort="fast"),
        ),
    ),
    Try(
        "Ask for a range within 0 to",
        lambda: decode(encode(surface(n=40), rms=1.0, effort="fast").data, frames=range(5, 90)),
        (
            lambda text: decode(
                encode(surface(n=40), rms=1.0, effort="fast").data,
                frames=range(int(number_in(text, "0 to"))),
            ),
        ),
    ),
    Try(
        "State the number of vertices per frame, or the grid.",
        lambda: read_raw(write_raw(surface()), None),
        (
            lambda _: read_raw(write_raw(surface()), 120),
            lambda _: read_raw(write_raw(surface()), None, grid=(12, 10)),
        ),
    ),
    Try(
        "Keep one.",
        lambda: ReadOptions(times=(0.0,), frame_interval=1.0),
        (lambda _: ReadOptions(times=(0.0,)), lambda _: ReadOptions(frame_interval=1.0)),
    ),
    Try(
        "State handedness right, or coordinates unknown.",
        lambda: Facts(handedness="left", coordinates="LPS"),
        (
            lambda _: Facts(handedness="right", coordinates="LPS"),
            lambda _: Facts(handedness="left", coordinates="unknown"),
        ),
    ),
    Try(
        "State a period of at least",
        lambda: surface(times=np.arange(12.0), facts=Facts(period=2.0)),
        (
            lambda text: surface(
                times=np.arange(12.0), facts=Facts(period=number_in(text, "at least"))
            ),
            lambda _: surface(times=np.arange(12.0)),
            lambda _: surface(times=np.arange(12.0) / 6, facts=Facts(period=2.0)),
        ),
    ),
    Try(
        "Give the number of a vertex, counted from 0, or three finite coordinates",
        lambda: facts_from_texts({"landmark:apex": "top"}),
        (
            lambda _: facts_from_texts({"landmark:apex": "7"}),
            lambda _: facts_from_texts({"landmark:apex": "0,0,-40"}),
        ),
    ),
    Try(
        "Write one wavenumber for each axis, then cos or sin: 1,1,cos; or, on a mesh",
        lambda: parse_label("first"),
        (lambda _: parse_label("1,1,cos"), lambda _: parse_label("spring 3")),
    ),
    Try(
        "Use its cosine.",
        lambda: modes_named(CUP, [parse_label("1,0,sin")]),
        (lambda _: modes_named(CUP, [parse_label("1,0,cos")]),),
    ),
    Try(
        "or give the sequences themselves, which are then fitted in one basis",
        lambda: train([*of_balls(), TrainingCase(springs(), "0", "s")], "x", QUICK),
        (
            lambda _: train(of_balls(), "x", QUICK),
            lambda _: train(of_balls(as_sequences=True), "x", QUICK),
        ),
    ),
    Try(
        "Use modes or tolerance, or kind=material",
        lambda: fitted(kind=SignatureKind.NORMAL_DISPLACEMENT, auto=True),
        (
            lambda _: fitted(kind=SignatureKind.NORMAL_DISPLACEMENT, modes=7),
            lambda _: fitted(kind=SignatureKind.NORMAL_DISPLACEMENT, tolerance=5.0),
            lambda _: fitted(kind=SignatureKind.MATERIAL, auto=True),
        ),
    ),
    Try(
        "Omit components, or use kind=material",
        lambda: fitted(kind=SignatureKind.NORMAL_DISPLACEMENT, components=Components.CYLINDRICAL),
        (
            lambda _: fitted(kind=SignatureKind.NORMAL_DISPLACEMENT),
            lambda _: fitted(kind=SignatureKind.MATERIAL, components=Components.CYLINDRICAL),
        ),
    ),
    Try(
        "Leave them out (--skip-unreadable, on_error = 'leave out'), state one topology for all",
        lambda: train(
            [*of_balls(), TrainingCase(fitted(surface("torus"), modes=7), "0", "s")], "x", QUICK
        ),
        (lambda _: train(of_balls(), "x", QUICK),),
    ),
    Try(
        "needs no tracking: it is for `modalmotion signature`",
        lambda: read_observed(write_npz(surface())),
        (lambda _: modal_signature(read_sequence(write_npz(surface())).sequence),),
    ),
)


@pytest.mark.every(2)
@pytest.mark.parametrize("one", TRIED, ids=lambda one: one.remedy[:50])
def test_a_remedy_that_is_followed_helps(one: Try) -> None:
    text = remedy_of(one.wrong)
    for part in one.remedy.split("…"):
        assert part.strip(" .") in text, text
    for right in one.right:
        right(text)


def notes_of(sequence: MeshSequence, **parameters: Any) -> str:
    return " ".join(map(str, fitted(sequence, **parameters).notes))


def test_what_notes_advise_helps() -> None:
    ball = mesh_sequence(*moving("sphere"), unit="mm")
    round_ball = mesh_sequence(
        np.stack(
            [
                v := moving("sphere")[0][0]
                / np.linalg.norm(moving("sphere")[0][0], axis=1)[:, None],
                1.1 * v,
            ]
        ),
        moving("sphere")[1],
        unit="mm",
    )
    assert "state the landmark theta_zero (--landmark theta_zero=PLACE)" in notes_of(round_ball)
    turned = Facts(landmarks={"theta_zero": 40})
    assert "zero of theta" not in notes_of(round_ball.with_facts(turned))
    flat = mesh_sequence(moving("plane")[0] * [1, 1, 0], moving("plane")[1], unit="mm")
    assert "otherwise set topology=cup" in notes_of(flat)
    advice = notes_of(flat, topology="cup")
    assert "state the landmarks apex and base (--landmark apex=PLACE)" in advice
    z = np.array([0.0, 0.0, 10.0])
    placed = Facts(landmarks={"apex": tuple(-z), "base": tuple(z)})
    assert "direction of the axis" not in notes_of(flat.with_facts(placed), topology="cup")
    sheet = mesh_sequence(*moving("plane"), unit="mm")
    assert "set topology=plane" in notes_of(sheet)
    assert fitted(sheet, topology="plane").surface == "plane"
    wrong = surface(facts=Facts(landmarks={"apex": int(lowest_and_highest()[1])}))
    advice = notes_of(wrong)
    assert "fold" in advice
    assert "the landmarks apex and base" in advice
    right = surface(facts=Facts(landmarks={"apex": lowest_and_highest()[0]}))
    assert "fold" not in notes_of(right)
    volume = clinical_readouts(fitted(ball), ball)
    assert any("State the fact cavity" in note for note in volume.notes)
    stated = ball.with_facts(Facts(cavity="la"))
    assert not clinical_readouts(fitted(stated), stated).notes


def test_advice_reads_the_same_on_the_command_line(tmp_path: Path) -> None:
    vertices, faces = moving()
    path, collapsed = tmp_path / "cup.npz", tmp_path / "point.npz"
    low, high = lowest_and_highest()
    path.write_bytes(write_npz(surface()))
    np.savez(collapsed, vertices=np.ones_like(vertices), faces=faces)

    def run(*words: str) -> str:
        done = CliRunner().invoke(main, list(words))
        assert done.exit_code == (0 if "note" in done.output or not done.stderr else 1)
        return " ".join((done.output + done.stderr).split())

    assert "--landmark apex=PLACE" in run("signature", str(path), "--landmark", f"apex={high}")
    assert "fold" not in run("signature", str(path), "--landmark", f"apex={low}")
    assert "with an area" in run("signature", str(collapsed))


def test_every_option_command_and_setting_that_is_named_exists() -> None:
    from modalmotion_service.settings import Settings

    known_options: set[str] = set()
    known_commands: set[str] = set()

    def collect(group: click.Group, words: str) -> None:
        context = click.Context(group)
        for name in group.list_commands(context):
            command = group.get_command(context, name)
            assert command is not None
            known_commands.add(f"{words} {name}")
            for p in command.params:
                known_options.update((*p.opts, *p.secondary_opts))
            if isinstance(command, click.Group):
                collect(command, f"{words} {name}")

    collect(main, "modalmotion")
    settings = {f"MODALMOTION_{name.upper()}" for name in Settings.model_fields}
    for place, text in sentences():
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]*", text):
            assert option in known_options, (place, text)
        for command in re.findall(r"`(modalmotion [a-z-]+(?: [a-z]+)?)", text):
            first_two = " ".join(command.split()[:2])
            assert {command, first_two} & known_commands, (place, text)
        for setting in re.findall(r"MODALMOTION_[A-Z_]+", text):
            assert setting in settings, (place, text)


# They name an option and cannot be followed here: why, or where they are.
ELSEWHERE = {
    "State the landmark theta_zero": "classification/answer: of a cup whose zero is weak",
    "To continue without such files, use --skip-unreadable": "tests/core/cli/test_model_commands",
    "Write --landmarks apex=1,2,3": "tests/core/cli/test_track_commands.py",
    "Start more services with --stateless": "tests/service/routes/test_stateless.py",
    "Check the folder that is named as": "tests/service/workspace/test_read_only.py",
    "a service that was started without --stateless": "tests/service/routes/test_stateless.py",
    "Leave --label out": "tests/core/cli/test_track_commands.py",
    "Name one of these with --label": "tests/core/tracking/test_label_values.py",
    "Name the cavity (--label VALUE)": "tests/core/tracking/test_label_values.py",
    "Label more slices": "tests/core/tracking/test_label_slices.py",
    "Name a .png, or track images with --picture data": "tests/core/cli/test_track_commands.py",
    "Name another owner of FOLDER: --owner": "tests/core/cli/test_store_commands.py",
    "Ask for less at once, or allow more as `most_bytes`": "tests/core/client",
    "Change it with `update_sequence`": "tests/core/store",
    "; or restore it from a backup": "tests/core/store",
    "Use it inside `with ResultStore(...)`": "all tests of the store",
    "Choose the modes from the lattice itself, with `lowest_modes`": "tests/core/modes",
    "Give rng=numpy.random.default_rng(seed)": "tests/core/simulate",
    "Use what `view_payload`": "tests/core/viewer",
    "Leave --bulls-eye out": "tests/core/cli",
    "Give the times or the interval of the frames": "tests/core/clinical",
    "numpy.array": "written as it stands",
    "numpy.savez": "written as it stands",
    "`modalmotion ": "the command exists, see above; a store or a service of another",
    "MODALMOTION_": "the setting exists, see above; a service",
}


def test_each_remedy_that_names_an_option_is_tried() -> None:
    options = {f.name for kind in (SignatureParameters, ReadOptions) for f in fields(kind)}
    tried = [part for one in TRIED for part in one.remedy.split("…") if len(part) > 8]
    for place, text in remedies():
        if not named_in(text, options):
            continue
        known = any(part.strip() in text for part in (*tried, *ELSEWHERE))
        assert known, f"{place}: no test follows {text!r}; add one to TRIED"
