"""A small moving mesh, written in every format by the plainest code there is."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.formats import write_glb, write_npz, write_vtkhdf
from modalmotion.formats.glb import File
from modalmotion.formats.glb_writing import MorphAnimation, write_container
from modalmotion.limits import NO_LIMITS
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence

N_FRAMES: Final = 3
N_VERTICES: Final = 12
TIMES: Final = (0.0, 0.5, 1.25)

_rng = np.random.default_rng(7)
# Exact in float32 and in a few digits of text.
VERTICES: Final = _rng.integers(-4096, 4096, size=(N_FRAMES, N_VERTICES, 3)).astype(np.float32) / 64
FACES: Final = np.array([[i, (i + 1) % 12, (i + 5) % 12] for i in range(12)], dtype=np.int64)


def sequence(**others: Any) -> MeshSequence:
    return mesh_sequence(VERTICES, FACES, **others)


def text(row: Iterable[Any]) -> str:
    return " ".join(repr(float(x)) for x in row)


def stl_binary(
    positions: NDArray[Any], faces: NDArray[Any] = FACES, header: bytes = b"made by a test"
) -> bytes:
    table = np.zeros(len(faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("x", "<u2")])
    table["corners"] = positions[faces]
    return header.ljust(80, b"\0") + len(faces).to_bytes(4, "little") + table.tobytes()


def stl_text(positions: NDArray[Any], faces: NDArray[Any] = FACES) -> bytes:
    lines = ["solid vertex 1 2 3"]
    for triangle in positions[faces]:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += [f"vertex {text(corner)}" for corner in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid", ""]).encode()


def obj(positions: NDArray[Any], polygons: Any = FACES) -> bytes:
    lines = ["# a comment", "mtllib elsewhere.mtl", "o thing"]
    lines += [f"v {text(row)}" for row in positions]
    lines += ["vn 0 0 1", "vt 0.5 0.5", "usemtl red"]
    lines += ["f " + " ".join(f"{i + 1}/1/1" for i in polygon) for polygon in polygons]
    return "\n".join([*lines, ""]).encode()


def off(positions: NDArray[Any], polygons: Any = FACES) -> bytes:
    lines = ["OFF # a comment", f"{len(positions)} {len(polygons)} 0"]
    lines += [text(row) for row in positions]
    lines += [f"{len(p)} " + " ".join(map(str, p)) + " 255 0 0" for p in polygons]
    return "\n".join([*lines, ""]).encode()


def ply_header(form: str, n_vertices: int, n_faces: int, kind: str = "float") -> bytes:
    return "\n".join(
        [
            "ply",
            f"format {form} 1.0",
            "comment made by a test",
            f"element vertex {n_vertices}",
            *(f"property {kind} {axis}" for axis in "xyz"),
            "property uchar red",
            f"element face {n_faces}",
            "property list uchar int vertex_indices",
            "property float quality",
            "end_header\n",
        ]
    ).encode()


def ply_text(positions: NDArray[Any], polygons: Any = FACES) -> bytes:
    rows = [f"{text(row)} 7" for row in positions]
    rows += [f"{len(p)} " + " ".join(map(str, p)) + " 0.5" for p in polygons]
    header = ply_header("ascii", len(positions), len(polygons))
    return header + "\n".join([*rows, ""]).encode()


def ply_binary(positions: NDArray[Any], polygons: Any = FACES, order: str = "<") -> bytes:
    form = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    vertices = np.zeros(len(positions), [("xyz", order + "f4", 3), ("red", "u1")])
    vertices["xyz"] = positions
    body = vertices.tobytes()
    for polygon in polygons:
        body += bytes([len(polygon)]) + np.array(polygon, order + "i4").tobytes()
        body += np.array([0.5], order + "f4").tobytes()
    return ply_header(form, len(positions), len(polygons)) + body


def vtk_text(positions: NDArray[Any], polygons: Any = FACES) -> bytes:
    n_corners = sum(len(p) + 1 for p in polygons)
    lines = ["# vtk DataFile Version 3.0", "made by a test", "ASCII", "DATASET POLYDATA"]
    lines += [f"POINTS {len(positions)} float", *(text(row) for row in positions)]
    lines += [f"POLYGONS {len(polygons)} {n_corners}"]
    lines += [f"{len(p)} " + " ".join(map(str, p)) for p in polygons]
    return "\n".join([*lines, ""]).encode()


def vtp_text(positions: NDArray[Any], polygons: Any = FACES, field: str = "") -> bytes:
    corners = " ".join(str(i) for p in polygons for i in p)
    ends = " ".join(map(str, np.cumsum([len(p) for p in polygons])))
    return f"""<?xml version="1.0"?>
<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<PolyData>{field}<Piece NumberOfPoints="{len(positions)}" NumberOfPolys="{len(polygons)}">
<Points><DataArray type="Float32" Name="Points" NumberOfComponents="3" format="ascii">
{" ".join(text(row) for row in positions)}</DataArray></Points>
<Polys><DataArray type="Int64" Name="connectivity" format="ascii">{corners}</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">{ends}</DataArray></Polys>
</Piece></PolyData></VTKFile>
""".encode()


MESH_WRITERS: Final[dict[str, tuple[str, Callable[..., bytes]]]] = {
    "stl": ("stl", stl_binary),
    "stl text": ("stl", stl_text),
    "ply": ("ply", ply_binary),
    "ply text": ("ply", ply_text),
    "obj": ("obj", obj),
    "off": ("off", off),
}
"""Name, suffix and writer of each format of one mesh a file that needs nothing else."""

VTK_WRITERS: Final[dict[str, tuple[str, Callable[..., bytes]]]] = {
    "vtk": ("vtk", vtk_text),
    "vtp": ("vtp", vtp_text),
}


def zipped(members: dict[str, bytes], compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content, compress_type=compression)
    return buffer.getvalue()


def frame_zip(write: Callable[..., bytes], suffix: str, **others: bytes) -> bytes:
    members = {f"frame_{i}.{suffix}": write(VERTICES[i]) for i in range(N_FRAMES)}
    return zipped(members | others)


def pvd(entries: list[tuple[float, str]]) -> bytes:
    rows = "".join(
        f'<DataSet timestep="{time}" group="" part="0" file="{name}"/>' for time, name in entries
    )
    return (
        '<?xml version="1.0"?><VTKFile type="Collection" version="0.1"><Collection>'
        f"{rows}</Collection></VTKFile>"
    ).encode()


def series(entries: list[tuple[float, str]]) -> bytes:
    files = [{"name": name, "time": time} for time, name in entries]
    return json.dumps({"file-series-version": "1.0", "files": files}).encode()


def animation(n_targets: int = 2) -> MorphAnimation:
    rng = np.random.default_rng(3)
    angles = np.array([0.0, 0.4, 2.0])
    c, s, zero, one = np.cos(angles), np.sin(angles), np.zeros(3), np.ones(3)
    rotations = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    return MorphAnimation(
        base=VERTICES[0].astype(np.float64),
        targets=rng.normal(size=(n_targets, N_VERTICES, 3)),
        target_names=tuple(f"target {i}" for i in range(n_targets)),
        weights=rng.normal(size=(N_FRAMES, n_targets)),
        rotations=np.ascontiguousarray(rotations),
        translations=rng.normal(size=(N_FRAMES, 3)),
        faces=FACES,
        times=np.array(TIMES),
        unit="mm",
    )


def edited_glb(data: bytes, edit: Callable[[dict[str, Any]], object]) -> bytes:
    """A GLB file with its document changed and everything around it made to fit."""
    container = File(data, NO_LIMITS)
    document = json.loads(json.dumps(container.document))
    edit(document)
    return write_container(document, bytes(container.binary))


def all_files() -> dict[str, bytes]:
    """One good file of each format, by name."""
    files = {name: write(VERTICES[0]) for name, (_, write) in MESH_WRITERS.items()}
    files |= {
        f"{name} zip": frame_zip(write, suffix) for name, (suffix, write) in MESH_WRITERS.items()
    }
    files["npz"] = write_npz(sequence(times=TIMES, unit="mm"))
    files["vtkhdf"] = write_vtkhdf(sequence(times=TIMES, unit="mm"))
    files["glb"] = write_glb(animation())
    return files
