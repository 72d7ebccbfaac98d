"""What a .vtp file declares is compared with its bytes, however it is written."""

from __future__ import annotations

import base64
import re
import struct
from collections.abc import Callable

import numpy as np
import pytest
from format_samples import FACES, VERTICES, vtp_text

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion.formats.vtk_xml import read_vtk_xml
from modalmotion.limits import DEFAULT_LIMITS

PLAIN = vtp_text(VERTICES[0])
ENTITY = b'<!DOCTYPE VTKFile [<!ENTITY a "999999999">]>'


def declares(text: bytes) -> bytes:
    return PLAIN.replace(b'NumberOfPoints="12"', text, 1)


def test_a_plain_file_is_read() -> None:
    for data in (
        PLAIN,
        b"\xef\xbb\xbf" + PLAIN,
        PLAIN.replace(b"<Points>", b"<!-- a --><?b c?><Points>"),
        declares(b"NumberOfPoints\n=\t'&#x31;2'"),
    ):
        assert np.array_equal(read_vtk_xml(data).positions, VERTICES[0])


@pytest.mark.parametrize("size", [b"1500000", b"999999999", b"13", b"11", b"-12", b"12x"])
@pytest.mark.parametrize("text", [b'NumberOfPoints ="{}"', b"NumberOfPoints=' {}'"])
def test_other_sizes_are_refused(text: bytes, size: bytes) -> None:
    with pytest.raises(InputError):
        read_vtk_xml(declares(text.replace(b"{}", size)), DEFAULT_LIMITS)


@pytest.mark.parametrize(
    "edit",
    [
        lambda data: data.replace(b"<VTKFile", b"<!-- <VTKFile -->" + ENTITY + b"<VTKFile", 1),
        lambda data: data.replace(b"<VTKFile", b"<?a <VTKFile ?>" + ENTITY + b"<VTKFile", 1),
        lambda data: data.replace(b"<VTKFile", b"<!DOCTYPE VTKFile SYSTEM 'x.dtd'><VTKFile", 1),
        lambda data: data.replace(b'version="1.0"?', b'version="1.0" encoding="UTF-7"?', 1),
        lambda data: data.replace(b"<VTKFile", b"<x>").replace(b"</VTKFile>", b"</x>"),
        lambda data: data.replace(b'"12"', b'"\xd9\xa3"'),
        lambda data: data.replace(b"Points>", b"Dots>"),
        lambda data: data.replace(b'"offsets"', b'"ends"'),
        lambda data: data.replace(b"Float32", b"Float8"),
        lambda data: re.sub(b'"U?Int[0-9]+"', b'"Float64"', data),
        lambda data: re.sub(b'(connectivity"[^>]*>)\\s*0 ', rb"\g<1>18446744073709551616 ", data),
        lambda data: data[:600],
    ],
)
def test_what_is_no_surface_is_refused(edit: Callable[[bytes], bytes]) -> None:
    with pytest.raises(MalformedFileError) as caught:
        read_vtk_xml(edit(PLAIN), DEFAULT_LIMITS)
    assert caught.value.remedy


def array(content: bytes, attributes: str, appended: bytes = b"</VTKFile>") -> bytes:
    """Write points in the element or behind all."""
    start, end = PLAIN.index(b"<DataArray"), PLAIN.index(b"</DataArray>")
    tag = f'<DataArray type="Float32" Name="Points" NumberOfComponents="3" {attributes}>'
    return PLAIN[:start] + tag.encode() + content + PLAIN[end:].replace(b"</VTKFile>", appended)


POINTS = VERTICES[0].astype("<f4").tobytes()


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("word", ["I", "Q"])
@pytest.mark.parametrize("where", ["element", "base64", "raw"])
@pytest.mark.parametrize(
    ("words", "passes"),
    [
        ((144,), True),
        ((143,), False),
        ((145,), False),
        ((10**8,), False),
        ((10**8, 0, 0), False),
        ((10**8, 144, 0), False),
        ((1, 10**9, 0), False),
        ((1, 144, 10**9), False),
        ((2, 144, 0, 50, 50), False),
    ],
)
def test_heads_of_arrays_are_compared_with_their_elements(
    words: tuple[int, ...], passes: bool, where: str, word: str, order: str
) -> None:
    content = struct.pack(f"{order}{len(words)}{word}", *words)
    content += VERTICES[0].astype(f"{order}f4").tobytes()
    if where != "raw":
        content = base64.b64encode(content)
    if where == "element":
        data = array(b"\n " + content, 'format="binary"')
    else:
        behind = b'<AppendedData encoding="%s">\n_abc' % where.encode() + content
        behind += b" </AppendedData></VTKFile>"
        data = array(b"", 'format="appended" offset="3"', behind)
    data = data.replace(b' header_type="UInt64"', b"" if word == "I" else b' header_type="UInt64"')
    if order == ">":
        data = data.replace(b"LittleEndian", b"BigEndian")
    if len(words) > 1:
        data = data.replace(b" byte_order", b' compressor="vtkZLibDataCompressor" byte_order')
    if passes:
        assert np.array_equal(read_vtk_xml(data).positions, VERTICES[0])
        return
    with pytest.raises(InputError) as caught:
        read_vtk_xml(data, DEFAULT_LIMITS)
    assert caught.value.remedy


def test_another_compressor_is_refused_with_those_that_are_read() -> None:
    packed = base64.b64encode(struct.pack("<4Q", 1, 144, 0, 144)) + base64.b64encode(POINTS)
    data = array(packed, 'format="binary"')
    data = data.replace(b" byte_order", b' compressor="vtkLZ4DataCompressor" byte_order')
    with pytest.raises(MalformedFileError, match="vtkLZ4DataCompressor") as caught:
        read_vtk_xml(data)
    assert "ZLib" in caught.value.remedy


@pytest.mark.parametrize(
    ("edit", "limit"),
    [(b"<a/>" * 2_000 + b"<PolyData", "xml_elements"), (b"<a>" * 50, "xml_depth")],
)
def test_each_limit_is_named(edit: bytes, limit: str) -> None:
    with pytest.raises(LimitError) as caught:
        read_vtk_xml(PLAIN.replace(b"<PolyData", edit, 1), DEFAULT_LIMITS)
    assert caught.value.limit == limit
    assert caught.value.remedy


def test_arrays_at_one_place_are_refused() -> None:
    # In a thousand arrays the same megabyte would be read a thousand times.
    one = '<DataArray type="UInt8" Name="TimeValue" format="appended" offset="0"/>' * 20
    content = struct.pack("<Q", 1_000_000) + bytes(1_000_000)
    behind = b'<AppendedData encoding="raw">\n_' + content + b"</AppendedData></VTKFile>"
    field = f"<PolyData><FieldData>{one}</FieldData>".encode()
    data = PLAIN.replace(b"</VTKFile>", behind).replace(b"<PolyData>", field)
    with pytest.raises(MalformedFileError, match="on one another"):
        read_vtk_xml(data)


@pytest.mark.parametrize("corner", [b"12", b"-1"])
def test_a_piece_has_no_corners_of_another(corner: bytes) -> None:
    start, end = PLAIN.index(b"<Piece"), PLAIN.index(b"</Piece>") + 8
    piece = PLAIN[start:end]
    both = read_vtk_xml(PLAIN.replace(piece, piece * 2))
    assert np.array_equal(both.positions, np.concatenate([VERTICES[0]] * 2))
    assert np.array_equal(both.faces, np.concatenate([FACES, FACES + 12]))
    at = piece.index(b">", piece.index(b'"connectivity"')) + 1
    words = piece[at : piece.index(b"<", at)].split()
    damaged = piece[:at] + b" ".join([corner, *words[1:]]) + piece[piece.index(b"<", at) :]
    with pytest.raises(MalformedFileError, match="names vertex"):
        read_vtk_xml(PLAIN.replace(piece, piece + damaged))
