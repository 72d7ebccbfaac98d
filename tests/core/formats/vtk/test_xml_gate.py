"""What a .vtp file declares is compared with its bytes, however it is written."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from format_samples import VERTICES, vtp_text

from modalmotion.errors import InputError, LimitError, MalformedFileError
from modalmotion.formats.vtk.xml_gate import require_plain_xml
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
