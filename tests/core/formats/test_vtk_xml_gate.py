"""What a .vtp file declares is compared with its bytes, however it is written."""

from __future__ import annotations

import base64
import struct
from collections.abc import Callable

import pytest
from format_samples import VERTICES, vtp_text

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion.formats.vtk_xml_gate import require_plain_xml
from modalmotion.limits import DEFAULT_LIMITS

PLAIN = vtp_text(VERTICES[0])
ENTITY = b'<!DOCTYPE VTKFile [<!ENTITY a "999999999">]>'


def declares(text: bytes) -> bytes:
    return PLAIN.replace(b'NumberOfPoints="12"', text, 1)


def test_a_plain_file_passes() -> None:
    require_plain_xml(PLAIN, DEFAULT_LIMITS)
    require_plain_xml(b"\xef\xbb\xbf" + PLAIN, DEFAULT_LIMITS)
    require_plain_xml(PLAIN.replace(b"<Points>", b"<!-- a --><?b c?><Points>"), DEFAULT_LIMITS)


@pytest.mark.parametrize(
    "text",
    [
        b'NumberOfPoints ="{}"',
        b"NumberOfPoints\n=\t'{}'",
        b"NumberOfPoints = '{}'",
        b'NumberOfPoints=" {} "',
        b'NumberOfPoints="&#57;&#57;{}"',
        b'NumberOfPoints="&#x39;&#x39;{}"',
        b'NumberOfPoints="{}" NumberOfVerts="0"',
    ],
)
@pytest.mark.parametrize("size", [b"1500000", b"999999999"])
def test_a_size_is_read_however_it_is_written(text: bytes, size: bytes) -> None:
    with pytest.raises(InputError) as caught:
        require_plain_xml(declares(text.replace(b"{}", size)), DEFAULT_LIMITS)
    assert "vertices" in str(caught.value) or "declares" in str(caught.value)


@pytest.mark.parametrize(
    "edit",
    [
        lambda data: data.replace(b"<VTKFile", b"<!-- <VTKFile -->" + ENTITY + b"<VTKFile", 1),
        lambda data: data.replace(b"<VTKFile", b"<?a <VTKFile ?>" + ENTITY + b"<VTKFile", 1),
        lambda data: data.replace(b"<VTKFile", ENTITY + b"\n<VTKFile", 1),
        lambda data: data.replace(b"<VTKFile", b"<!DOCTYPE VTKFile SYSTEM 'x.dtd'><VTKFile", 1),
        lambda data: data.replace(b'version="1.0"?', b'version="1.0" encoding="UTF-16"?', 1),
        lambda data: data.replace(b'version="1.0"?', b'version="1.0" encoding="UTF-7"?', 1),
        lambda data: data.decode().encode("utf-16"),
        lambda data: data.decode().encode("utf-16-be"),
        lambda data: data.replace(b'"PolyData"', b'"ImageData"'),
        lambda data: data.replace(b"<VTKFile", b"<x>").replace(b"</VTKFile>", b"</x>"),
        lambda data: data.replace(b'"12"', b'"-12"'),
        lambda data: data.replace(b'"12"', b'"12x"'),
        lambda data: data.replace(b'"12"', b'"\xd9\xa3"'),
        lambda data: data.replace(b'Components="3"', b'Components="99999"'),
        lambda data: data.replace(b"<Points>", b"<PointData><Array NumberOfComponents='9999'/>"),
        lambda data: data.replace(b"<PolyData>", b"<PolyData><Array NumberOfTuples='99999'/>"),
        # A compressor allows for more, and not by a second root.
        lambda data: declares(b'NumberOfPoints="5000"').replace(
            b"<PolyData>", b"<PolyData><VTKFile compressor='x'/>"
        ),
        lambda data: data[:600],
    ],
)
def test_what_hides_is_refused(edit: Callable[[bytes], bytes]) -> None:
    with pytest.raises(MalformedFileError) as caught:
        require_plain_xml(edit(PLAIN), DEFAULT_LIMITS)
    assert caught.value.remedy


def test_compressed_numbers_may_be_more_than_the_bytes() -> None:
    data = declares(b'NumberOfPoints="5000"')
    with pytest.raises(MalformedFileError, match="more than its"):
        require_plain_xml(data, DEFAULT_LIMITS)
    require_plain_xml(data.replace(b"<VTKFile", b"<VTKFile compressor='z'", 1), DEFAULT_LIMITS)


def test_what_is_appended_is_not_xml() -> None:
    appended = b"<AppendedData encoding='raw'>_\x00\xff<a <b &" + b"<" + b"x" * 100_000
    require_plain_xml(PLAIN.replace(b"</VTKFile>", appended), DEFAULT_LIMITS)


def array(head: bytes, attributes: str, appended: bytes = b"</VTKFile>") -> bytes:
    """Write points behind a head, in the element or behind all."""
    start, end = PLAIN.index(b"<DataArray"), PLAIN.index(b"</DataArray>")
    tag = f'<DataArray type="Float32" Name="Points" NumberOfComponents="3" {attributes}>'
    return PLAIN[:start] + tag.encode() + head + PLAIN[end:].replace(b"</VTKFile>", appended)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("word", ["I", "Q"])
@pytest.mark.parametrize("where", ["element", "base64", "raw"])
@pytest.mark.parametrize(
    ("words", "passes"),
    [
        ((144,), True),
        ((10**8,), False),
        ((1, 144, 0), True),
        ((1, 32768, 144), True),
        ((9, 16, 0), True),
        ((2, 100, 44), True),
        ((10**8, 0, 0), False),
        ((10**8, 144, 0), False),
        ((1, 10**9, 0), False),
        ((1, 144, 10**9), False),
    ],
)
def test_heads_of_arrays_are_compared_with_their_elements(
    words: tuple[int, ...], passes: bool, where: str, word: str, order: str
) -> None:
    head = struct.pack(f"{order}{len(words)}{word}", *words)
    if where != "raw":
        head = base64.b64encode(head)
    if where == "element":
        data = array(b"\n " + head, 'format="binary"')
    else:
        behind = b'<AppendedData encoding="%s">\n_abc' % where.encode() + head + b" </AppendedData>"
        data = array(b"", 'format="appended" offset="3"', behind)
    data = data.replace(b' header_type="UInt64"', b"" if word == "I" else b' header_type="UInt64"')
    if order == ">":
        data = data.replace(b"LittleEndian", b"BigEndian")
    if len(words) == 3:
        data = data.replace(b" byte_order", b' compressor="vtkZLibDataCompressor" byte_order')
    if passes:
        require_plain_xml(data, DEFAULT_LIMITS)
        return
    with pytest.raises(MalformedFileError, match="array 'Points' of"):
        require_plain_xml(data, DEFAULT_LIMITS)


@pytest.mark.parametrize("start", [b"<!--<AppendedData>_-->", b"<a b='<AppendedData'/>"])
def test_what_vtk_would_take_for_appended_is_an_element(start: bytes) -> None:
    behind = b'<AppendedData encoding="raw">_' + (144).to_bytes(8, "little") + b"</AppendedData>"
    data = array(b"", 'format="appended" offset="0"', behind)
    require_plain_xml(data, DEFAULT_LIMITS)
    with pytest.raises(MalformedFileError):
        require_plain_xml(data.replace(b"<PolyData>", b"<PolyData>" + start), DEFAULT_LIMITS)


@pytest.mark.parametrize(
    ("edit", "limit"),
    [
        (b"<PolyData " + b" ".join(b'a%d=""' % i for i in range(60)), "xml_attributes"),
        (b"<PolyData" + b" " * 100_000, "markup_bytes"),
        (b"<!--" + b"<>" * 100_000 + b"--><PolyData", "markup_bytes"),
        (b"<?a " + b"<>" * 100_000 + b"?><PolyData", "markup_bytes"),
        (b"<a/>" * 2_000 + b"<PolyData", "xml_elements"),
        (b"<a>" * 50 + b"</a>" * 50 + b"<PolyData", "xml_depth"),
    ],
)
def test_each_limit_is_named(edit: bytes, limit: str) -> None:
    with pytest.raises(LimitError) as caught:
        require_plain_xml(PLAIN.replace(b"<PolyData", edit, 1), DEFAULT_LIMITS)
    assert caught.value.limit == limit
    assert caught.value.remedy
