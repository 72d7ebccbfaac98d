"""One function for all formats: what is detected, and what may be stated beside a file."""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from format_samples import (
    N_FRAMES,
    N_VERTICES,
    TIMES,
    VERTICES,
    all_files,
    animation,
    frame_zip,
    obj,
    sequence,
    vtk_text,
    vtp_text,
    zipped,
)

from modalmotion.errors import InputError, LimitError, MalformedFileError, ParameterError
from modalmotion.formats import (
    Format,
    ParserHere,
    ParserProcess,
    ReadLimits,
    ReadOptions,
    detect_format,
    read_sequence,
    write_glb,
    write_npz,
    write_raw,
    write_vtkhdf,
)
from modalmotion.mesh.sequence import MeshSequence

EXPECTED = {name: name.partition(" ")[0] for name in all_files()} | {
    "vtkhdf": "hdf5",
    **{name: "zip" for name in all_files() if name.endswith("zip")},
}


@pytest.mark.parametrize("name", EXPECTED)
def test_the_content_tells_the_format(name: str) -> None:
    assert detect_format(all_files()[name]) == EXPECTED[name]


@pytest.mark.parametrize(
    ("data", "expected"), [(vtk_text(VERTICES[0]), "vtk"), (vtp_text(VERTICES[0]), "vtp")]
)
def test_vtk_files_are_told_apart(data: bytes, expected: str) -> None:
    assert detect_format(data) == expected


def test_a_binary_stl_may_begin_like_a_text() -> None:
    from format_samples import stl_binary

    data = stl_binary(VERTICES[0], header=b"solid, says an exporter that does not know better")
    assert read_sequence(data).format == "stl"


def test_a_name_plays_no_part(tmp_path: Path) -> None:
    for name, data in all_files().items():
        path = tmp_path / "sequence.stl"
        path.write_bytes(data)
        assert read_sequence(path).sequence.id == read_sequence(data).sequence.id, name
    assert read_sequence(str(path)).sequence.id == read_sequence(path).sequence.id


@pytest.mark.parametrize(
    "write",
    [write_npz, write_vtkhdf, lambda s: write_raw(s, "float64")],
    ids=["npz", "hdf5", "raw"],
)
def test_each_output_reads_back(write: Callable[[MeshSequence], bytes]) -> None:
    given = sequence(times=TIMES, unit="mm")
    data = write(given)
    found = detect_format(data)
    if found is None:
        options = ReadOptions(format=Format.RAW, n_vertices=N_VERTICES, dtype="float64")
        read = read_sequence(data, options).sequence
        assert np.array_equal(read.vertices, given.vertices)
    else:
        assert read_sequence(data).sequence.id == given.id


def test_raw_numbers_take_their_shape_from_what_is_stated() -> None:
    data = VERTICES.astype("<f4").tobytes()
    by_count = read_sequence(data, ReadOptions(format=Format.RAW, n_vertices=12, unit="mm"))
    assert np.array_equal(by_count.sequence.vertices, VERTICES)
    assert (by_count.sequence.unit, by_count.unit_from) == ("mm", "caller")
    by_grid = read_sequence(
        data, ReadOptions(format=Format.RAW, grid=(3, 4), topology="cup", frame_interval=0.5)
    )
    assert by_grid.sequence.grid == (3, 4)
    assert by_grid.sequence.topology is not None
    assert by_grid.sequence.times is not None
    assert by_grid.sequence.times.tolist() == [0.0, 0.5, 1.0]
    assert by_grid.times_from == "caller"


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        (ReadOptions(format=Format.RAW), ParameterError, "number of vertices"),
        (ReadOptions(format=Format.RAW, n_vertices=0), ParameterError, "number of vertices"),
        (ReadOptions(format=Format.RAW, n_vertices=7), MalformedFileError, "not a whole number"),
        (ReadOptions(format=Format.RAW, n_vertices=10**12), MalformedFileError, "not a whole"),
        (ReadOptions(format=Format.RAW, n_vertices=12, dtype="f2"), ParameterError, "'f2'"),
        (
            ReadOptions(format=Format.RAW, n_vertices=12, limits=ReadLimits(frames=2)),
            LimitError,
            "frames",
        ),
        (
            ReadOptions(format=Format.RAW, n_vertices=12, limits=ReadLimits(vertices=11)),
            LimitError,
            "vertices",
        ),
        (ReadOptions(), MalformedFileError, "Unrecognised file format"),
    ],
)
def test_raw_numbers_that_do_not_fit_say_why(
    options: ReadOptions, error: type[InputError], words: str
) -> None:
    with pytest.raises(error) as caught:
        read_sequence(VERTICES.astype("<f4").tobytes(), options)
    assert words in str(caught.value)
    assert caught.value.remedy


def test_what_is_stated_goes_over_what_the_file_says() -> None:
    read = read_sequence(
        write_npz(sequence(times=TIMES, unit="mm")),
        ReadOptions(unit="cm", times=(1.0, 2.0, 3.0), topology="cup", grid=(3, 4)),
    )
    assert read.sequence.unit == "cm"
    assert read.sequence.times is not None
    assert read.sequence.times.tolist() == [1.0, 2.0, 3.0]
    assert read.sequence.grid == (3, 4)
    assert (read.unit_from, read.times_from) == ("caller", "caller")
    assert "in mm; it was taken for cm" in read.notes[-1]


def test_where_nobody_says_so_it_is_unknown() -> None:
    read = read_sequence(frame_zip(obj, "obj"))
    assert (read.sequence.unit, read.unit_from) == (None, None)
    assert (read.sequence.times, read.times_from) == (None, None)
    assert read.coordinate_system is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"times": (0.0,), "frame_interval": 0.1}, "Keep one"),
        ({"frame_interval": 0.0}, "above zero"),
        ({"frame_interval": float("nan")}, "above zero"),
    ],
)
def test_options_that_contradict_are_refused(options: dict[str, object], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        replace(ReadOptions(), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "options",
    [
        ReadOptions(unit="furlong"),
        ReadOptions(times=(0.0, 1.0)),
        ReadOptions(times=(0.0, 1.0, 1.0)),
        ReadOptions(times=(0.0, float("inf"), 1.0)),
        ReadOptions(grid=(5, 5)),
        ReadOptions(topology="klein bottle"),
        ReadOptions(format=Format.GLB),
        ReadOptions(format=Format.ZIP),
        ReadOptions(format=Format.HDF5),
        ReadOptions(format=Format.STL),
    ],
)
def test_what_does_not_fit_the_file_is_refused(options: ReadOptions) -> None:
    with pytest.raises(InputError) as caught:
        read_sequence(write_npz(sequence()), options)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "empty"),
        (b"   \n", "Unrecognised file format"),
        (b"hello, world", "Unrecognised file format"),
        (b"<html><body>Not found</body></html>", "Unrecognised file format"),
        (b"MATLAB 5.0 MAT-file, made by a test", "MATLAB"),
        (b'{"asset": {"version": "2.0"}}', ".glb"),
        (b"\x1f\x8b\x08" + bytes(40), "compressed"),
        (b"<VTKFile type='ImageData'>", "ImageData"),
        (b"<VTKFile type='Collection'>", "Collection"),
        (b"\x89HDF\r\n\x1a\n", "cannot be read"),
        (zipped({"a.txt": b"x"}), "no frames"),
        (zipped({"data.npy": b"x"}, zipfile.ZIP_STORED), "no 'vertices'"),
    ],
)
def test_what_is_no_sequence_says_what_it_looks_like(data: bytes, words: str) -> None:
    with pytest.raises(MalformedFileError) as caught:
        read_sequence(data)
    assert words in str(caught.value)
    assert caught.value.remedy


def test_an_error_names_the_format_it_comes_from() -> None:
    with pytest.raises(MalformedFileError) as caught:
        read_sequence(write_glb(animation())[:-1])
    assert caught.value.details["format"] == "glb"


def test_a_parser_that_takes_too_long_is_ended() -> None:
    with ParserProcess(ReadLimits(), seconds=0.001) as parser:
        with pytest.raises(LimitError) as caught:
            read_sequence(write_vtkhdf(sequence()), parser=parser)
        assert caught.value.limit == "parser_seconds"
        assert caught.value.remedy


def test_a_parser_that_is_left_ends_its_process() -> None:
    # With another limit than usual it is no parser that tests share.
    with ParserProcess(ReadLimits(), seconds=30.0) as parser:
        read_sequence(write_vtkhdf(sequence()), parser=parser)
        child = parser._child
    assert child is not None
    assert child.poll() is not None


def test_a_parser_without_work_starts_no_process() -> None:
    with ParserProcess(ReadLimits()) as parser:
        read_sequence(write_npz(sequence()), parser=parser)
        assert parser._child is None


def test_reading_hdf5_by_itself_needs_no_parser() -> None:
    assert read_sequence(write_vtkhdf(sequence())).sequence.n_frames == N_FRAMES


def test_importing_the_formats_needs_none_of_their_libraries() -> None:
    import subprocess

    code = "import sys, modalmotion.formats; print(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"h5py", "trimesh", "vtk", "vtkmodules"} & set(run.stdout.split())


def test_a_parser_in_this_process_reads_the_same() -> None:
    data = write_vtkhdf(sequence(times=TIMES, unit="mm"))
    here = read_sequence(data, parser=ParserHere(ReadLimits()))
    assert here.sequence.id == read_sequence(data).sequence.id
    with pytest.raises(LimitError):
        read_sequence(data, parser=ParserHere(ReadLimits(frames=2)))
