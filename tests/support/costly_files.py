"""Small files made to keep a reader busy, in every format."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from typing import Any, Final

import h5py
import numpy as np
from format_samples import (
    FACES,
    N_VERTICES,
    VERTICES,
    animation,
    obj,
    ply_binary,
    ply_text,
    pvd,
    sequence,
    series,
    vtk_text,
    vtp_text,
    zipped,
)

from modalmotion.formats import write_glb, write_npz, write_vtkhdf
from modalmotion.formats.glb import File
from modalmotion.formats.glb_writing import write_container
from modalmotion.limits import NO_LIMITS

Edit = Callable[[dict[str, Any]], object]


def glb(edit: Edit) -> bytes:
    container = File(write_glb(animation()), NO_LIMITS)
    document = json.loads(json.dumps(container.document))
    edit(document)
    return write_container(document, bytes(container.binary))


def _mesh_node(document: dict[str, Any]) -> int:
    return next(i for i, node in enumerate(document["nodes"]) if "mesh" in node)


def glb_one_mesh(n: int) -> bytes:
    """Many nodes that show one mesh."""

    def edit(document: dict[str, Any]) -> None:
        mesh = document["nodes"][_mesh_node(document)]["mesh"]
        first = len(document["nodes"])
        document["nodes"] += [{"mesh": mesh}] * n
        document["scenes"][document.get("scene", 0)]["nodes"] += list(range(first, first + n))

    return glb(edit)


def glb_chain(n: int) -> bytes:
    """A mesh at the end of a long chain of nodes."""

    def edit(document: dict[str, Any]) -> None:
        first = len(document["nodes"])
        document["nodes"] += [{"children": [first + i + 1]} for i in range(n - 1)]
        document["nodes"].append({"children": [_mesh_node(document)]})
        document["scenes"][document.get("scene", 0)]["nodes"] = [first]

    return glb(edit)


def glb_chain_of_meshes(n: int) -> bytes:
    """A long chain of nodes that all show a mesh."""

    def edit(document: dict[str, Any]) -> None:
        mesh = document["nodes"][_mesh_node(document)]["mesh"]
        first = len(document["nodes"])
        document["nodes"] += [{"children": [first + i + 1], "mesh": mesh} for i in range(n - 1)]
        document["nodes"].append({"mesh": mesh})
        document["scenes"][document.get("scene", 0)]["nodes"] = [first]

    return glb(edit)


def glb_primitives(n: int) -> bytes:
    """A mesh of many parts over one accessor."""

    def edit(document: dict[str, Any]) -> None:
        mesh = document["meshes"][0]
        mesh["primitives"] = [dict(mesh["primitives"][0]) for _ in range(n)]

    return glb(edit)


def glb_parts(n: int) -> bytes:
    """A mesh of many parts, each with accessors of its own over the same bytes."""

    def edit(document: dict[str, Any]) -> None:
        accessors, mesh = document["accessors"], document["meshes"][0]
        part = mesh["primitives"][0]
        position = accessors[part["attributes"]["POSITION"]]
        first = len(accessors)
        accessors += [position] * n
        mesh["primitives"] = [{**part, "attributes": {"POSITION": first + i}} for i in range(n)]

    return glb(edit)


def glb_targets(n: int) -> bytes:
    """A mesh of many morph targets over one accessor."""

    def edit(document: dict[str, Any]) -> None:
        mesh = document["meshes"][0]
        for part in mesh["primitives"]:
            part["targets"] = [part["targets"][0]] * n
        mesh.pop("weights", None)
        document.pop("animations", None)

    return glb(edit)


def glb_channels(n: int) -> bytes:
    """An animation of many channels over one sampler."""

    def edit(document: dict[str, Any]) -> None:
        channels = document["animations"][0]["channels"]
        moved = next(c for c in channels if c["target"]["path"] == "translation")
        sampler = moved["sampler"]
        channels += [
            {"sampler": sampler, "target": {"node": 9 + i, "path": "translation"}} for i in range(n)
        ]

    return glb(edit)


def glb_nodes(n: int) -> bytes:
    """A scene of many empty nodes."""

    def edit(document: dict[str, Any]) -> None:
        first = len(document["nodes"])
        document["nodes"] += [{}] * n
        document["scenes"][document.get("scene", 0)]["nodes"] += list(range(first, first + n))

    return glb(edit)


def glb_wide(n: int) -> bytes:
    """A chain of nodes, each with a mesh beside the next of the chain: n times its depth."""

    def edit(document: dict[str, Any]) -> None:
        mesh = document["nodes"][_mesh_node(document)]["mesh"]
        first = len(document["nodes"])
        depth = n // 2
        document["nodes"] += [{"children": [first + i + 1]} for i in range(depth - 1)]
        leaves = list(range(first + depth, first + depth + n // 2))
        document["nodes"].append({"children": leaves})
        document["nodes"] += [{"mesh": mesh}] * len(leaves)
        document["scenes"][document.get("scene", 0)]["nodes"] = [first]

    return glb(edit)


def glb_zeros(n: int) -> bytes:
    """A mesh whose vertices are declared and not there."""

    def edit(document: dict[str, Any]) -> None:
        part = document["meshes"][0]["primitives"][0]
        for place in (part["attributes"]["POSITION"], *(t["POSITION"] for t in part["targets"])):
            document["accessors"][place]["count"] = n
            document["accessors"][place].pop("bufferView", None)

    return glb(edit)


def glb_children(n: int) -> bytes:
    """Scenes left out, so that the roots are what is nobody's child."""

    def edit(document: dict[str, Any]) -> None:
        document.pop("scenes")
        document.pop("scene", None)
        document["nodes"] += [{"children": []}] * n

    return glb(edit)


def glb_keys(n: int) -> bytes:
    """A document with many keys that nobody reads."""
    return glb(lambda document: document.update({"extras": {f"k{i}": [] for i in range(n)}}))


def glb_animations(n: int) -> bytes:
    """Many animations beside the one that is read."""
    return glb(lambda d: d.update({"animations": d["animations"] + [{"channels": []}] * n}))


def vtp_attributes(n: int, tag: str = "<PolyData") -> bytes:
    """Many attributes on one element, which VTK looks up one after the other."""
    many = " ".join(f'a{i}="{i}"' for i in range(n))
    return vtp_text(VERTICES[0]).replace(tag.encode(), f"{tag} {many}".encode(), 1)


def vtp_elements(n: int, element: str = "<DataArray/>") -> bytes:
    """Many elements in one."""
    return vtp_text(VERTICES[0]).replace(b"<Points>", b"<Points>" + element.encode() * n, 1)


def vtp_depth(n: int) -> bytes:
    """Elements within elements."""
    return vtp_text(VERTICES[0], field="<a>" * n + "</a>" * n)


def vtp_arrays(n: int) -> bytes:
    """Many empty arrays of data."""
    array = '<DataArray type="Float32" Name="{}" format="ascii" NumberOfTuples="0"></DataArray>'
    fields = "".join(array.format(f"a{i}") for i in range(n))
    return vtp_text(VERTICES[0], field=f"<FieldData>{fields}</FieldData>")


def vtp_pieces(n: int) -> bytes:
    """Many empty pieces."""
    piece = '<Piece NumberOfPoints="0" NumberOfPolys="0"/>' * n
    return vtp_text(VERTICES[0]).replace(b"</PolyData>", piece.encode() + b"</PolyData>", 1)


def vtp_text_runs(n: int) -> bytes:
    """Text broken by many comments, of which each piece is joined to those before."""
    return vtp_text(VERTICES[0]).replace(b"</Points>", b" 1<!---->" * n + b"</Points>", 1)


def vtp_reversed_arrays(n: int) -> bytes:
    """Arrays with one name each, listed as the selection of every other."""
    array = (
        '<DataArray type="Float32" Name="a{}" NumberOfComponents="1" format="ascii">0</DataArray>'
    )
    points = "".join(array.format(i) for i in range(n))
    data = f"<PointData>{points}</PointData>".encode()
    return vtp_text(VERTICES[0]).replace(b"<Points>", data + b"<Points>", 1)


def vtk_fields(n: int) -> bytes:
    """A legacy file with many field arrays."""
    arrays = "\n".join(f"a{i} 1 1 float\n0" for i in range(n))
    return vtk_text(VERTICES[0]) + f"FIELD FieldData {n}\n{arrays}\n".encode()


def vtk_sections(n: int, section: str = "POINTS 1 float\n0 0 0\n") -> bytes:
    """A legacy file with one section again and again."""
    return vtk_text(VERTICES[0]) + section.encode() * n


def vtk_tables(n: int) -> bytes:
    """A legacy file with many lookup tables."""
    tables = "".join(f"LOOKUP_TABLE t{i} 1\n0 0 0 1\n" for i in range(n))
    return vtk_text(VERTICES[0]) + f"POINT_DATA {N_VERTICES}\n{tables}".encode()


def hdf5(edit: Callable[[h5py.File], object]) -> bytes:
    buffer = io.BytesIO(write_vtkhdf(sequence()))
    with h5py.File(buffer, "r+") as file:
        edit(file)
    return buffer.getvalue()


def hdf5_groups(n: int) -> bytes:
    return hdf5(lambda file: [file.create_group(f"g{i}") for i in range(n)])


def hdf5_depth(n: int) -> bytes:
    def edit(file: h5py.File) -> None:
        group = file
        for _ in range(n):
            group = group.create_group("g")

    return hdf5(edit)


def hdf5_links(n: int) -> bytes:
    """Many names of one dataset."""

    def edit(file: h5py.File) -> None:
        file["x"] = np.zeros(1)
        group = file.create_group("links")
        for i in range(n):
            group[f"g{i}"] = file["x"]

    return hdf5(edit)


def hdf5_attributes(n: int) -> bytes:
    def edit(file: h5py.File) -> None:
        for g in range(n // 500):
            group = file.create_group(f"g{g}")
            for i in range(500):
                group.attrs[f"a{i}"] = i

    return hdf5(edit)


def hdf5_datasets(n: int) -> bytes:
    def edit(file: h5py.File) -> None:
        for i in range(n):
            file[f"d{i}"] = np.zeros(1)

    return hdf5(edit)


def hdf5_chunks(n: int) -> bytes:
    """Points in chunks of one each, which are looked up one by one."""

    def edit(file: h5py.File) -> None:
        points = np.zeros((n, 3))
        del file["VTKHDF/Points"]
        file["VTKHDF"].create_dataset("Points", data=points, chunks=(1, 3), compression="gzip")

    return hdf5(edit)


def hdf5_zeros(n: int) -> bytes:
    """Frames of zeros, packed a thousandfold."""

    def edit(file: h5py.File) -> None:
        root = file["VTKHDF"]
        del root["Points"], root["NumberOfPoints"]
        root.create_dataset("Points", data=np.zeros((10_000 * n, 3)), compression="gzip")
        root["NumberOfPoints"] = [10_000]
        steps = root["Steps"]
        steps.attrs["NSteps"] = n
        for name, rows in (
            ("Values", np.arange(n, dtype=float)),
            ("PointOffsets", 10_000 * np.arange(n)),
            ("PartOffsets", np.zeros(n, int)),
            ("NumberOfParts", np.ones(n, int)),
            ("CellOffsets", np.zeros((n, 4), int)),
            ("ConnectivityIdOffsets", np.zeros((n, 4), int)),
        ):
            del steps[name]
            steps[name] = rows

    return hdf5(edit)


def hdf5_large_chunks(n: int) -> bytes:
    """Frames in one large chunk."""

    def edit(file: h5py.File) -> None:
        points = np.resize(file["VTKHDF/Points"][()], (n * N_VERTICES, 3))
        del file["VTKHDF/Points"]
        file["VTKHDF"].create_dataset(
            "Points", data=points, chunks=points.shape, compression="gzip"
        )
        steps = file["VTKHDF/Steps"]
        steps.attrs["NSteps"] = n
        for name, rows in (
            ("Values", np.arange(n, dtype=float)),
            ("PointOffsets", N_VERTICES * np.arange(n)),
            ("PartOffsets", np.zeros(n, int)),
            ("NumberOfParts", np.ones(n, int)),
            ("CellOffsets", np.zeros((n, 4), int)),
            ("ConnectivityIdOffsets", np.zeros((n, 4), int)),
        ):
            del steps[name]
            steps[name] = rows

    return hdf5(edit)


def hdf5_members(n: int) -> bytes:
    """Many datasets of one type of a thousand members."""

    def edit(file: h5py.File) -> None:
        file["t"] = np.dtype([(f"a{i}", "u1") for i in range(1_000)])
        for i in range(n):
            file.create_dataset(f"d{i}", (1,), file["t"])

    return hdf5(edit)


def npz_members(n: int) -> bytes:
    buffer = io.BytesIO(write_npz(sequence()))
    with zipfile.ZipFile(buffer, "a") as archive:
        for i in range(n):
            archive.writestr(zipfile.ZipInfo(f"a{i}.npy"), b"")
    return buffer.getvalue()


def npz_zeros(n: int) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, vertices=np.zeros((n, 10_000, 3), np.float32), faces=FACES)
    return buffer.getvalue()


def npz_text(n: int) -> bytes:
    buffer = io.BytesIO()
    arrays = dict(np.load(io.BytesIO(write_npz(sequence()))))
    np.savez_compressed(buffer, **arrays, landmarks=np.array("[" * n), covariates=np.array("{" * n))
    return buffer.getvalue()


def zip_members(n: int) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("0.obj", obj(VERTICES[0]))
        for i in range(n):
            archive.writestr(zipfile.ZipInfo(f"n{i}.txt"), b"")
    return buffer.getvalue()


def zip_repeated(n: int, line: bytes = b"v 1 2 3\n", n_frames: int = 1) -> bytes:
    return zipped({f"{i}.obj": line * n for i in range(n_frames)})


def zip_overlapping(n: int) -> bytes:
    """Many names of one member's bytes."""
    content = ply_text(np.tile(VERTICES[0], (1000, 1)))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("f00000.ply", content)
        archive.start_dir = archive.fp.tell()  # type: ignore[union-attr]
        first = archive.infolist()[0]
        for i in range(1, n):
            twin = zipfile.ZipInfo(f"f{i:05d}.ply")
            for name in ("compress_type", "CRC", "compress_size", "file_size", "header_offset"):
                setattr(twin, name, getattr(first, name))
            archive.filelist.append(twin)
            archive.NameToInfo[twin.filename] = twin
        archive._didModify = True  # type: ignore[attr-defined]
    return buffer.getvalue()


def zip_quoted(n: int) -> bytes:
    """A list of frames that names one file again and again."""
    listed = series([(float(i), "0.ply") for i in range(n)])
    return zipped({"0.ply": ply_binary(np.tile(VERTICES[0], (1000, 1))), "x.series": listed})


def zip_pvd_attributes(n: int) -> bytes:
    many = " ".join(f'a{i}="{i}"' for i in range(n)).encode()
    listed = pvd([(0.0, "0.ply")]).replace(b"<Collection", b"<Collection " + many, 1)
    return zipped({"0.ply": ply_binary(VERTICES[0]), "x.pvd": listed})


def zip_pvd_entries(n: int) -> bytes:
    return zipped(
        {"0.ply": ply_binary(VERTICES[0]), "x.pvd": pvd([(float(i), "0.ply") for i in range(n)])}
    )


def zip_pvd_depth(n: int) -> bytes:
    listed = pvd([(0.0, "0.ply")]).replace(
        b"<Collection>", b"<Collection>" + b"<a>" * n + b"</a>" * n
    )
    return zipped({"0.ply": ply_binary(VERTICES[0]), "x.pvd": listed})


def zip_series_depth(n: int) -> bytes:
    return zipped({"0.ply": ply_binary(VERTICES[0]), "x.series": b"[" * n})


def zip_names(n: int) -> bytes:
    """Names of digits and letters in turn, and hundreds of folders."""
    return zipped({f"{'1a' * (n // 2)}{i}.obj": obj(VERTICES[0]) for i in range(30)})


def ply_properties(n: int) -> bytes:
    lines = "".join(f"property uchar p{i}\n" for i in range(n)).encode()
    return ply_binary(VERTICES[0]).replace(b"property uchar red\n", lines, 1)


def ply_elements(n: int) -> bytes:
    lines = "".join(f"element e{i} 0\nproperty uchar x\n" for i in range(n)).encode()
    return ply_binary(VERTICES[0]).replace(b"end_header", lines + b"end_header", 1)


def ply_empty_lists(n: int) -> bytes:
    """Text rows of faces with no corners."""
    return ply_text(VERTICES[0], [[0, 1, 2]] + [[]] * n)


def obj_corners(n: int) -> bytes:
    """Faces of very many corners, each a fan."""
    return obj(VERTICES[0]) + (b"f " + b"1 " * n + b"\n") * 20


def obj_negative(n: int) -> bytes:
    return obj(VERTICES[0]) + b"f -1 -2 -3\n" * n


def obj_continued(n: int) -> bytes:
    """Lines that go on and on."""
    return obj(VERTICES[0]) + b"f 1 2 \\\n" * n + b"3\n"


def stl_solids(n: int) -> bytes:
    return b"solid a\nendsolid a\n" * n


def off_polygons(n: int) -> bytes:
    return b"OFF\n3 %d 0\n0 0 0\n1 0 0\n0 1 0\n" % n + b"0\n" * n


COSTLY: Final[dict[str, Callable[[], bytes]]] = {
    "glb of one mesh": lambda: glb_one_mesh(1_000),
    "glb of one mesh, many": lambda: glb_one_mesh(50_000),
    "glb of one mesh, very many": lambda: glb_one_mesh(300_000),
    "glb chain": lambda: glb_chain(20_000),
    "glb chain of meshes": lambda: glb_chain_of_meshes(3_000),
    "glb chain with leaves": lambda: glb_wide(4_000),
    "glb primitives": lambda: glb_primitives(20_000),
    "glb parts": lambda: glb_parts(20_000),
    "glb targets": lambda: glb_targets(50_000),
    "glb channels": lambda: glb_channels(50_000),
    "glb nodes": lambda: glb_nodes(90_000),
    "glb zeros": lambda: glb_zeros(1_900_000),
    "glb without scenes": lambda: glb_children(300_000),
    "glb keys": lambda: glb_keys(100_000),
    "glb animations": lambda: glb_animations(300_000),
    "vtp attributes": lambda: vtp_attributes(60_000),
    "vtp attributes of the root": lambda: vtp_attributes(60_000, "<VTKFile"),
    "vtp attributes of an array": lambda: vtp_attributes(60_000, "<DataArray"),
    "vtp elements": lambda: vtp_elements(50_000),
    "vtp depth": lambda: vtp_depth(50_000),
    "vtp arrays": lambda: vtp_arrays(10_000),
    "vtp arrays of points": lambda: vtp_reversed_arrays(5_000),
    "vtp pieces": lambda: vtp_pieces(20_000),
    "vtp text in pieces": lambda: vtp_text_runs(100_000),
    "vtk fields": lambda: vtk_fields(30_000),
    "vtk sections": lambda: vtk_sections(30_000),
    "vtk tables": lambda: vtk_tables(20_000),
    "vtk metadata": lambda: vtk_sections(30_000, "METADATA\nINFORMATION 0\n\n"),
    "hdf5 groups": lambda: hdf5_groups(11_000),
    "hdf5 depth": lambda: hdf5_depth(2_000),
    "hdf5 links": lambda: hdf5_links(8_000),
    "hdf5 attributes": lambda: hdf5_attributes(8_000),
    "hdf5 datasets": lambda: hdf5_datasets(3_000),
    "hdf5 chunks": lambda: hdf5_chunks(5_000),
    "hdf5 zeros": lambda: hdf5_zeros(200),
    "hdf5 large chunks": lambda: hdf5_large_chunks(9_900),
    "hdf5 members": lambda: hdf5_members(50),
    "npz members": lambda: npz_members(20_000),
    "npz zeros": lambda: npz_zeros(400),
    "npz brackets": lambda: npz_text(1_000_000),
    "zip members": lambda: zip_members(20_000),
    "zip of one line": lambda: zip_repeated(1_900_000),
    "zip of one line, frames": lambda: zip_repeated(1_900_000, n_frames=4),
    "zip of comments": lambda: zip_repeated(200_000, b"#\n" * 60),
    "zip of blanks": lambda: zip_repeated(200_000, b"\n" * 100),
    "zip overlapping": lambda: zip_overlapping(2_000),
    "zip listed again": lambda: zip_quoted(5_000),
    "zip pvd attributes": lambda: zip_pvd_attributes(100_000),
    "zip pvd entries": lambda: zip_pvd_entries(300_000),
    "zip pvd depth": lambda: zip_pvd_depth(100_000),
    "zip series depth": lambda: zip_series_depth(1_000_000),
    "zip names": lambda: zip_names(60_000),
    "ply properties": lambda: ply_properties(3_000),
    "ply elements": lambda: ply_elements(1_500),
    "ply empty lists": lambda: ply_empty_lists(300_000),
    "obj corners": lambda: obj_corners(100_000),
    "obj negative": lambda: obj_negative(300_000),
    "obj continued": lambda: obj_continued(100_000),
    "stl solids": lambda: stl_solids(200_000),
    "off polygons": lambda: off_polygons(500_000),
}
"""Name and maker of each file."""
