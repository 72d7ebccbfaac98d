"""What a file or a command line nearly says: it is understood, or the error says what to do."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from modalmotion.cli.commands import main
from modalmotion.errors import (
    ConnectivityError,
    MalformedFileError,
    NonFiniteError,
    StoreError,
    TopologyError,
)
from modalmotion.formats import Format, ReadOptions, read_sequence
from modalmotion.formats.frame_files import notes_on_numbers
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import write_atomic

VERTICES = np.random.default_rng(8).normal(size=(4, 8 * 6, 3))


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_bytes_of_no_format_with_a_number_of_vertices_are_raw(dtype: str) -> None:
    data = VERTICES.astype(dtype).tobytes()
    read = read_sequence(data, ReadOptions(n_vertices=48, dtype=dtype))
    assert (read.sequence.vertices == VERTICES.astype(dtype)).all()


def test_a_number_of_vertices_makes_no_raw_of_another_format() -> None:
    file = io.BytesIO()
    np.savez(file, vertices=VERTICES)
    assert read_sequence(file.getvalue(), ReadOptions(n_vertices=7)).format == Format.NPZ


def test_raw_numbers_of_another_type_are_told_from_missing_points() -> None:
    data = np.full((1, 48, 3), np.nan).astype("<f4").tobytes()
    with pytest.raises(NonFiniteError, match="little-endian float32"):
        read_sequence(data, ReadOptions(n_vertices=48))


def test_raw_float64_is_read_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "beat.raw"
    path.write_bytes(VERTICES.astype("<f8").tobytes())
    words = ["--n-vertices", "48", "--dtype", "float64", "--grid", "8,6", "--topology", "cup"]
    result = CliRunner().invoke(main, ["signature", str(path), *words])
    assert result.exit_code == 0, result.output
    assert "cup, 4 frames, 48 vertices" in result.output


def test_points_that_nothing_joins_are_asked_for_a_lattice() -> None:
    with pytest.raises(TopologyError, match="grid"):
        modal_signature(mesh_sequence(VERTICES, unit="mm"), SignatureParameters(topology="cup"))


def test_a_single_array_is_told_how_to_become_an_archive() -> None:
    file = io.BytesIO()
    np.save(file, VERTICES)
    with pytest.raises(MalformedFileError, match=r"numpy\.savez"):
        read_sequence(file.getvalue())


def test_binary_stl_that_is_cut_short_is_told() -> None:
    whole = bytes(80) + np.uint32(40).tobytes() + bytes(50 * 40)
    with pytest.raises(MalformedFileError, match="STL that was cut short"):
        read_sequence(whole[:1000])


def test_a_pattern_that_the_shell_spread_is_told_to_be_quoted(tmp_path: Path) -> None:
    names = [str(tmp_path / f"scan_{k}.ply") for k in range(3)]
    result = CliRunner().invoke(main, ["signature", *names])
    assert result.exit_code == 2
    assert "3 files are named" in result.output
    assert "in quotes" in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ([1, 2, 4, 5], "leave out 1 frame, first between 'a_002.ply' and 'a_004.ply'"),
        ([0, 2, 4, 10], "leave out 2 frames"),
        ([0, 2, 4, 6], ""),
        ([5, 6, 7], ""),
        ([3, 9], ""),
    ],
)
def test_a_missing_number_is_told(numbers: list[int], said: str) -> None:
    notes = notes_on_numbers(tuple(f"a_{k:03}.ply" for k in numbers))
    assert len(notes) == bool(said)
    assert not said or said in notes[0]


def test_names_that_differ_in_more_than_a_number_are_left_alone() -> None:
    assert not notes_on_numbers(("a_1.ply", "a_2.ply", "b_7.ply"))
    assert not notes_on_numbers(("systole.ply", "diastole.ply", "rest.ply"))


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no folder 'nowhere'"):
        write_atomic(tmp_path / "nowhere" / "beat.h5", b"")


FACES = np.random.default_rng(4).permutation(48).reshape(-1, 3)


def test_faces_that_count_from_one_are_told() -> None:
    with pytest.raises(ConnectivityError, match="subtract 1"):
        mesh_sequence(VERTICES, faces=FACES + 1)


def test_swapped_axes_are_told() -> None:
    with pytest.raises(ConnectivityError, match=r"transpose\(1, 0, 2\)"):
        mesh_sequence(VERTICES.transpose(1, 0, 2), faces=FACES)


@pytest.mark.parametrize("shift", [-1, 7])
def test_other_faces_out_of_range_are_not_explained_away(shift: int) -> None:
    with pytest.raises(ConnectivityError, match="Use zero-based indices"):
        mesh_sequence(VERTICES, faces=FACES + shift)
