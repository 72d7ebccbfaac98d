"""Recognition of formats by content, not by name."""

import re
from enum import StrEnum
from typing import Final

from modalmotion.errors import MalformedFileError
from modalmotion.formats.text_meshes import KEYWORDS, OFF_KEYWORD, is_binary_stl
from modalmotion.hdf5.sealed import SIGNATURE


class Format(StrEnum):
    """Formats that can be read."""

    NPZ = "npz"
    HDF5 = "hdf5"
    ZIP = "zip"
    GLB = "glb"
    RAW = "raw"
    STL = "stl"
    PLY = "ply"
    OBJ = "obj"
    OFF = "off"
    VTK = "vtk"
    VTP = "vtp"
    VTU = "vtu"
    XDMF = "xdmf"
    MAT = "mat"


MESH_FORMATS: Final = frozenset(
    {Format.STL, Format.PLY, Format.OBJ, Format.OFF, Format.VTK, Format.VTP, Format.VTU}
)
"""Formats with one frame in each file."""

STREAM: Final = b"MMSQ"
"""First bytes of a compressed stream, which the codec reads."""

_HEAD: Final = 1 << 16
_VTK_XML: Final = re.compile(rb"<VTKFile[^>]{0,2000}?\stype=[\"'](\w{1,60})[\"']")

_VTK_XML_TYPES: Final = {b"PolyData": Format.VTP, b"UnstructuredGrid": Format.VTU}

OF_IMAGES: Final = (
    "Track a surface through it: `modalmotion report` for a segmentation, `modalmotion track`, "
    "track(path) in Python, or POST /v1/images and POST /v1/tracks."
)
"""Remedy for images."""

CONVERT: Final = (
    "Convert each frame: `pip install meshio`, then `meshio convert frame.msh frame.ply`, and name "
    "the folder of the .ply files."
)
"""Remedy for meshes of finite elements."""

# First bytes, behind a mark of their order and spaces.
_KNOWN: Final = (
    (rb"glTF", Format.GLB),
    (rb"ply\s", Format.PLY),
    (rb"# vtk DataFile", Format.VTK),
    (rb"(<\?xml[^>]*>\s*)?(<!DOCTYPE Xdmf[^>]{0,200}>\s*)?<Xdmf", Format.XDMF),
    (rb"MATLAB 5.0 MAT-file", Format.MAT),
    (rb"(?i:solid)", Format.STL),
)

# Known formats that cannot be read, each with a remedy.
_OTHERS: Final = (
    (
        rb"\x93NUMPY",
        "a single array (.npy)",
        "Write npz: numpy.savez('beat.npz', vertices=numpy.load('beat.npy'), faces=...).",
    ),
    (
        rb"\s*\{",
        "JSON (perhaps a .gltf)",
        "Convert it to .glb, with its data inside: `gltf-pipeline -i beat.gltf -o beat.glb`.",
    ),
    (
        rb"#VRML|#X3D|Kaydara FBX|; FBX|Ogawa|PXR-USDC|#usda|solid_collada|<COLLADA",
        "a scene of another program",
        "Open it in Blender and export glTF 2.0 (.glb), with its animation.",
    ),
    (
        rb"(?i:\s*(\*\*.*\s*)*\*(heading|node|part|include))|\$MeshFormat|\$\s*NASTRAN|MeshVersion",
        "a mesh for finite elements",
        CONVERT,
    ),
    (STREAM, "a compressed stream", "Decode it: `modalmotion decode beat.mms -o beat.npz`."),
    (
        rb"[\w ,;.+\-\t\"]{3,200}\r?\n\s*[-+\d.\"]",
        "a table of numbers",
        "Track a surface through points: `modalmotion track beat.csv -o beat.npz`.",
    ),
    (
        rb"NRRD000|ObjectType|NDims|(?s:.{128})DICM|(?s:.{344})n\+[12]\0|(?s:.{4})n\+2\0",
        "an image, not a surface",
        OF_IMAGES,
    ),
    (
        rb"\x1f\x8b|BZh|7z\xbc\xaf|Rar!|\xfd7zXZ",
        "a compressed file",
        f"If it is an image (.nii.gz): {OF_IMAGES[0].lower()}{OF_IMAGES[1:]} Else send .zip.",
    ),
)


def detect_format(data: bytes) -> Format | None:
    """Recognise the format by the first bytes; None if no format fits.

    Parameters
    ----------
    data : bytes
    """
    if data.startswith((b"PK\x03\x04", b"PK\x05\x06")):
        # The first member's name is at byte 30, its length at byte 26.
        name = data[30 : 30 + int.from_bytes(data[26:28], "little")]
        return Format.NPZ if name.endswith(b".npy") else Format.ZIP
    if data.startswith(SIGNATURE) or data[512:520] == SIGNATURE:
        return Format.HDF5
    head = data[:_HEAD].removeprefix(b"\xef\xbb\xbf").lstrip()
    if (kind := _vtk_xml_type(head)) in _VTK_XML_TYPES:
        return _VTK_XML_TYPES[kind]
    for pattern, form in _KNOWN:
        if re.match(pattern, head):
            return form
    if is_binary_stl(data):
        return Format.STL
    return _text_format(head)


def _text_format(head: bytes) -> Format | None:
    texts = (line.partition(b"#")[0].strip() for line in head.splitlines())
    first = next(filter(None, texts), b"")
    if OFF_KEYWORD.match(first):
        return Format.OFF
    return Format.OBJ if first and first.split()[0] in KEYWORDS else None


def _vtk_xml_type(head: bytes) -> bytes | None:
    match = _VTK_XML.search(head) if head.startswith(b"<") else None
    return None if match is None else match[1]


def unknown_format(data: bytes) -> MalformedFileError:
    """Make the error for bytes of an unknown format; it names what they look like."""
    if not data:
        return MalformedFileError("The file is empty.", remedy=_REMEDY)
    head = data[:_HEAD].removeprefix(b"\xef\xbb\xbf").lstrip()
    if (kind := _vtk_xml_type(head)) is not None:
        return MalformedFileError(
            f"The file is a VTK file of the type {kind.decode()!r}, not a surface.",
            remedy="Save a polygonal surface (.vtp, VTKHDF); pack a .pvd and its frames as .zip.",
        )
    for pattern, what, remedy in _OTHERS:
        if re.match(pattern, data):
            return MalformedFileError(f"The file is {what}, which cannot be read.", remedy=remedy)
    return MalformedFileError(f"Unrecognised file format ({len(data)} bytes).", remedy=_REMEDY)


_REMEDY: Final = (
    "Send npz, VTKHDF, a zip of frames (STL, PLY, OBJ, OFF, VTK), GLB with morph targets, or raw "
    "float32 with its shape stated. Binary STL that was cut short is not recognised."
)
