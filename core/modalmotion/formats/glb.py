"""GLB in: morph targets whose weights move, in one mesh that may move as a whole (glTF 2.0).

Positions are evaluated at the keyframes of what moves the mesh. What a file names is counted as it
is used: a few bytes may name the same part again and again.
"""

import json
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import scipy

from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.formats.frame import misread
from modalmotion.formats.glb_writing import BINARY, JSON, MAGIC, OURS, VERSION
from modalmotion.formats.result import Reading, reading_of
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh import NO_FACTS, Facts
from modalmotion.notes import Note
from modalmotion.representation import Array, Floats, Ints

_TRIANGLES: Final = 4
_STRIPS_AND_FANS: Final = (5, 6)
_COMPRESSED: Final = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
# Extensions that do not move vertices, or that are read.
_HARMLESS: Final = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_mesh_quantization")
_TYPES: Final[dict[object, str]] = dict(
    zip((5120, 5121, 5122, 5123, 5125, 5126), ("i1", "u1", "<i2", "<u2", "<u4", "<f4"), strict=True)
)
_SIZES: Final[dict[object, int]] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_COMPONENTS: Final = {"translation": 3, "rotation": 4, "scale": 3, "weights": 1}

# Bytes in memory for each byte of the file: a few shapes may move over a thousand frames.
_UNFOLDING: Final = 200

_malformed: Final = partial(
    MalformedFileError, remedy="Export the animation again as binary glTF (.glb)."
)


def read_glb(
    data: bytes, limits: ReadLimits = DEFAULT_LIMITS, *, animation: str | None = None
) -> Reading:
    """Read a sequence from a binary glTF file.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional
    animation : str, optional
        Name of the animation; the first by default.

    Returns
    -------
    Reading
        The one mesh of the scene. The unit is the metre by the format's definition, unless the
        file is our own and states another.

    Raises
    ------
    MalformedFileError
        If it cannot be read, has several meshes, names data elsewhere, is compressed, or is moved
        by a skeleton.
    LimitError
        If it declares more than `limits` accept.
    ParameterError
        If no animation has that name.
    """
    # Numbers of any size may be in a file; the validator finds overflows.
    what = "The document of the GLB file does not follow glTF"
    with np.errstate(all="ignore"), misread(_malformed, what):
        return _read(File(data, limits), animation)


class File:
    """The document and the bytes of a file, and how much of them has been used.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits

    Raises
    ------
    MalformedFileError
        If it is cut, of another version, or its document cannot be read.
    """

    def __init__(self, data: bytes, limits: ReadLimits) -> None:
        version, length = (int.from_bytes(data[at : at + 4], "little") for at in (4, 8))
        if data[:4] != MAGIC or len(data) < 20 or version != VERSION or length != len(data):
            raise _malformed(
                f"The GLB file declares version {version} and {length} bytes; {len(data)} are "
                f"there (version {VERSION} is read)."
            )
        parts, at = dict[bytes, memoryview](), 12
        while at < len(data):
            size, kind = int.from_bytes(data[at : at + 4], "little"), data[at + 4 : at + 8]
            if len(kind) != 4 or at + 8 + size > len(data):
                raise _malformed("A part of the GLB file is cut short.")
            parts.setdefault(kind, memoryview(data)[at + 8 : at + 8 + size])
            at += 8 + size
        with misread(_malformed, "The document of the GLB file cannot be read"):
            self.document: dict[str, Any] = json.loads(bytes(parts[JSON]))
        self.binary = parts.get(BINARY, memoryview(b""))
        self.limits = limits.of_file(len(data), _UNFOLDING)
        self._n_bytes = 0

    def hold(self, n_bytes: int) -> None:
        """Count the memory that parts take, each time that one is used.

        Raises
        ------
        LimitError
            If it is more than an animation of one surface needs.
        """
        self._n_bytes += n_bytes
        self.limits.require(decompressed_bytes=self._n_bytes)

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """Object of the document by its list and place in it.

        Raises
        ------
        MalformedFileError
            If it does not exist.
        """
        listed = self.document.get(kind)
        is_place = isinstance(index, int) and not isinstance(index, bool)
        if not (is_place and isinstance(listed, list) and 0 <= index < len(listed)):
            raise _malformed(f"The GLB file names {kind}[{str(index)[:20]}], which is not there.")
        member = listed[index]
        if not isinstance(member, dict):
            raise _malformed(f"The GLB file's {kind}[{index}] is not an object.")
        return member

    def array(
        self, index: object, n_components: int, limit: str | None = None, items_each: int = 1
    ) -> Array:
        """Read an accessor.

        Parameters
        ----------
        index : int
            Its place in the document's list.
        n_components : int
            Required numbers of each item.
        limit : {"frames", "vertices", "faces"}, optional
            Further limit, on the number of its items divided by `items_each`.
        items_each : int

        Returns
        -------
        (count, n_components) ndarray
            float64 for floats and normalised integers, else the integers as they are.

        Raises
        ------
        MalformedFileError
            If it leads out of the file, or is of another type.
        LimitError
            If it declares more than the limits accept.
        """
        accessor = self.item("accessors", index)
        count = _count(accessor, "count")
        if limit is not None:
            self.limits.require(**{limit: count // items_each})
        self.limits.require(decompressed_bytes=count * n_components * 8)
        code = _TYPES.get(accessor.get("componentType"))
        if code is None or _SIZES.get(accessor.get("type")) != n_components:
            raise _malformed(
                f"accessors[{index}] of the GLB file contains {str(accessor.get('type'))[:20]} of "
                f"{str(accessor.get('componentType'))[:20]}, not {n_components} numbers each."
            )
        dtype, shape = np.dtype(code), (count, n_components)
        values: Array = np.zeros(shape, dtype)
        if "bufferView" in accessor:
            values = self._items(accessor, shape, dtype)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            of_places = np.dtype(_TYPES[sparse["indices"].get("componentType")])
            n = _count(sparse, "count")
            places = self._items(sparse["indices"], (n, 1), of_places)[:, 0]
            if of_places.kind != "u" or int(places.max(initial=0)) >= max(count, 1):
                raise _malformed(f"A sparse accessor of the GLB file leads out of {count} items.")
            values[places] = self._items(sparse["values"], (n, n_components), dtype)
        if dtype.kind == "f":
            return values.astype(np.float64)
        if accessor.get("normalized") is True:
            # c / (2^(b-1) - 1), not below -1, for signed; c / (2^b - 1) for unsigned integers.
            return np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def _items(self, place: dict[str, Any], shape: tuple[int, int], dtype: np.dtype[Any]) -> Array:
        """Items from a place in a view, (count, components), that lie in the file."""
        view = self.item("bufferViews", index := place.get("bufferView"))
        uri = self.item("buffers", view.get("buffer")).get("uri", "")
        if uri or view["buffer"] != 0:
            raise MalformedFileError(
                f"The GLB file names data elsewhere ({str(uri)[:60]!r}), which is never opened.",
                remedy="Export one .glb file that contains its own data.",
            )
        start, length = _count(view, "byteOffset", 0), _count(view, "byteLength")
        data, item = self.binary[start : start + length], shape[1] * dtype.itemsize
        step, offset = _count(view, "byteStride", 0) or item, _count(place, "byteOffset", 0)
        end = offset + step * (shape[0] - 1) + item if shape[0] else offset
        if len(data) < length or step < item or end > length:
            raise _malformed(
                f"bufferViews[{index}] of the GLB file ends at byte {start + length} of "
                f"{len(self.binary)}, an accessor of it ends at byte {end} of {length}."
            )
        return np.ndarray(shape, dtype, data, offset, (step, dtype.itemsize)).copy()


def _count(owner: Any, name: str, default: int | None = None) -> int:
    value = owner.get(name, default)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**62:
        raise _malformed(f"The GLB file states {name} as {str(value)[:20]!r}.")
    return value


class Channel(NamedTuple):
    """Values of one property of a node, (keys, n), at its keyframes in s, and how it goes on."""

    times: Floats
    values: Floats
    is_step: bool = False
    is_rotation: bool = False

    def at(self, times: Floats) -> Floats:
        """Values at any times, held before the first and after the last key, (times, n)."""
        t = np.clip(times, self.times[0], self.times[-1])
        if self.is_step or len(self.times) == 1:
            return self.values[np.searchsorted(self.times, t, "right") - 1]
        if self.is_rotation:
            turns = scipy.spatial.transform.Rotation.from_quat(self.values)
            slerp = scipy.spatial.transform.Slerp(self.times, turns)
            return np.asarray(slerp(t).as_quat(), dtype=np.float64)
        return np.stack([np.interp(t, self.times, column) for column in self.values.T], axis=1)


Channels = dict[tuple[int, str], Channel]


def _channels(file: File, name: str | None, nodes: list[int]) -> tuple[Channels, list[str]]:
    """Read what moves these nodes in an animation, by property; name the other animations."""
    animations = file.document.get("animations", [])
    names = [str(a.get("name", i)) for i, a in enumerate(animations)]
    if name is not None and name not in names:
        raise ParameterError(
            f"There is no animation {name[:40]!r}; there are {', '.join(names[:8]) or 'none'}.",
            remedy="Name one of them, or leave the name out for the first.",
        )
    if not animations:
        return {}, []
    index = 0 if name is None else names.index(name)
    animation, movers = file.item("animations", index), set(nodes)
    channels: Channels = {}
    for listed in animation["channels"]:
        target, sampler = listed["target"], animation["samplers"][listed["sampler"]]
        path = target.get("path")
        if path in _COMPONENTS and target.get("node") in movers:
            channels[target["node"], path] = _channel(file, sampler, path)
    return channels, [other for i, other in enumerate(names) if i != index]


def _channel(file: File, sampler: dict[str, Any], path: str) -> Channel:
    mode, n = sampler.get("interpolation", "LINEAR"), _COMPONENTS[path]
    if mode not in ("LINEAR", "STEP"):
        raise MalformedFileError(
            f"An animation of the GLB file goes from key to key by {str(mode)[:20]!r}.",
            remedy="Export it sampled frame by frame, as Blender does ('Sampling Animations').",
        )
    times = file.array(sampler.get("input"), 1, "frames")[:, 0].astype(np.float64)
    values = file.array(sampler.get("output"), n).astype(np.float64)
    n_items, rest = divmod(len(values), len(times)) if len(times) else (0, 1)
    if rest or not n_items or (path != "weights" and n_items > 1):
        raise _malformed(
            f"An animation of the GLB file has {len(times)} keys and {len(values)} values for "
            f"{path}."
        )
    if not (np.isfinite(times).all() and np.isfinite(values).all() and (np.diff(times) > 0).all()):
        raise _malformed(
            "An animation of the GLB file has keys that are not finite or do not increase."
        )
    file.hold(times.nbytes + values.nbytes)
    return Channel(times, values.reshape(len(times), -1), mode == "STEP", path == "rotation")


def _read(file: File, animation: str | None) -> Reading:
    for name in map(str, file.document.get("extensionsRequired", [])):
        if not name.startswith(_HARMLESS):
            raise MalformedFileError(
                f"The GLB file cannot be read without {name[:60]!r}, which is unknown here.",
                remedy="Export again without extensions (no compression, no instancing).",
            )
    nodes = _nodes(file)
    channels, others = _channels(file, animation, nodes)
    keys = [channel.times for channel in channels.values()]
    times = np.unique(np.concatenate(keys)) if keys else np.zeros(1)
    file.limits.require(frames=len(times))
    shown, ignored = file.item("nodes", nodes[-1]), dict[str, None]()
    mesh = _mesh(file, shown["mesh"], ignored)
    file.limits.require(vertices=mesh.shapes.shape[1], faces=len(mesh.faces))
    file.hold(len(times) * mesh.shapes[0].nbytes)
    weights = np.array(shown.get("weights", mesh.weights), dtype=np.float64)[None]
    if (channel := channels.get((nodes[-1], "weights"))) is not None:
        weights = channel.at(times)
    world = np.eye(4)[None]
    for index in nodes:
        world = world @ _local(file.item("nodes", index), index, channels, times)
        file.hold(world.nbytes)
    moved = _placed(mesh, weights, world)
    vertices = np.broadcast_to(moved, (len(times), *moved.shape[1:])).copy()
    notes = [Note.of("no_animation")] if not channels else []
    if channels and len(mesh.shapes) == 1:
        notes.append(Note.of("no_morph_targets"))
    n_twice = len(vertices[0]) - len(np.unique(vertices[0], axis=0))
    if n_twice:
        notes.append(Note.of("vertices_split", n_vertices=n_twice))
    extras = file.document.get("asset", {}).get("extras", {})
    ours = extras.get(OURS, {}) if isinstance(extras, dict) else {}
    is_timed = bool(channels) and "times_unknown" not in ours
    return reading_of(
        vertices,
        mesh.faces,
        format="glb",
        grid=ours.get("grid"),
        topology=str(ours["topology"]) if "topology" in ours else None,
        times=times + float(ours.get("start_time", 0.0)) if is_timed else None,
        unit=None if "unit_unknown" in ours else str(ours.get("unit") or "m"),
        # glTF 2.0, 3.4: "a right-handed coordinate system". Our own files are written unturned.
        facts=NO_FACTS if ours else Facts(handedness="right"),
        unit_from="file" if "unit" in ours else "format",
        notes=notes,
        ignored=(*ignored, *(f"animation {name}" for name in others)),
        coordinate_system=None if ours else "Y up",
    )


def _nodes(file: File) -> list[int]:
    """Find the node that shows a mesh, and those above it, from the root of the scene."""
    scene = file.item("scenes", file.document.get("scene", 0))
    waiting: list[tuple[int | None, int]] = [(None, root) for root in scene.get("nodes", [])]
    above, shown = dict[int, int | None](), list[int]()
    while waiting:
        parent, index = waiting.pop()
        node = file.item("nodes", index)
        if index in above:
            raise _malformed(f"Node {index} of the GLB file has two parents, or is part of itself.")
        above[index] = parent
        shown += [index] * ("mesh" in node)
        waiting += [(index, child) for child in node.get("children", [])]
    if len(shown) != 1:
        raise MalformedFileError(
            f"The GLB file's scene shows {len(shown)} meshes.",
            remedy="Export one object: join the others to it (Blender: Object, Join), or leave "
            "them out.",
        )
    if "skin" in file.item("nodes", shown[0]):
        raise MalformedFileError(
            "The GLB file moves its mesh by a skeleton (skin), which is not evaluated.",
            remedy="Bake the animation to shape keys (morph targets) and export again, or "
            "export each frame as PLY or OBJ and send them as .zip.",
        )
    while (parent := above[shown[-1]]) is not None:
        shown.append(parent)
    return shown[::-1]


def _local(node: dict[str, Any], index: int, channels: Channels, times: Floats) -> Floats:
    if "matrix" in node:
        # Column by column.
        return _numbers(node, "matrix", [0.0] * 16).reshape(1, 4, 4).transpose(0, 2, 1)
    parts = {
        path: channels[index, path].at(times)
        if (index, path) in channels
        else _numbers(node, path, rest)[None]
        for path, rest in (
            ("translation", [0.0, 0.0, 0.0]),
            ("rotation", [0.0, 0.0, 0.0, 1.0]),
            ("scale", [1.0, 1.0, 1.0]),
        )
    }
    local = np.zeros((max(map(len, parts.values())), 4, 4))
    # M = T R S
    turns = scipy.spatial.transform.Rotation.from_quat(parts["rotation"])
    local[:, :3, :3] = turns.as_matrix() * parts["scale"][:, None, :]
    local[:, :3, 3] = parts["translation"]
    local[:, 3, 3] = 1.0
    return local


def _numbers(node: dict[str, Any], name: str, default: list[float]) -> Floats:
    values = np.array(node.get(name, default), dtype=np.float64)
    if values.shape != (len(default),) or not np.isfinite(values).all():
        raise _malformed(f"A node of the GLB file has the {name} {str(node.get(name))[:60]}.")
    return values


class _Mesh(NamedTuple):
    """Vertices and the targets that move them, (1 + targets, vertices, 3); triangles; weights."""

    shapes: Floats
    faces: Ints
    weights: Floats


def _mesh(file: File, index: int, ignored: dict[str, None]) -> _Mesh:
    """Read all primitives of a mesh as one; those over the same accessors share vertices."""
    mesh = file.item("meshes", index)
    # First vertex and number of vertices of each set of accessors.
    placed = dict[tuple[Any, ...], tuple[int, int]]()
    blocks, faces, n_vertices = list[Floats](), list[Ints](), 0
    for primitive in mesh["primitives"]:
        is_plain = not _COMPRESSED & primitive.get("extensions", {}).keys()
        if not is_plain or primitive.get("mode", _TRIANGLES) in _STRIPS_AND_FANS:
            raise MalformedFileError(
                "The GLB file's mesh is compressed, or of triangle strips or fans.",
                remedy="Export again as triangles without compression.",
            )
        attributes = primitive["attributes"]
        ignored |= dict.fromkeys(str(name) for name in attributes if name != "POSITION")
        # A target that moves normals only has no positions.
        listed = [target.get("POSITION") for target in primitive.get("targets", [])]
        key = (attributes["POSITION"], *listed)
        if key not in placed:
            base = file.array(attributes["POSITION"], 3, "vertices")
            file.hold((1 + len(listed)) * base.size * 8)
            block = np.zeros((1 + len(listed), *base.shape))
            for place, accessor in enumerate(key):
                if accessor is not None:
                    shape = file.array(accessor, 3, "vertices") if place else base
                    if shape.shape != base.shape:
                        raise _malformed(
                            f"Morph target {place - 1} of the GLB file has {len(shape)} vertices, "
                            f"the mesh {len(base)}."
                        )
                    block[place] = shape
            blocks.append(block)
            placed[key] = n_vertices, len(base)
            n_vertices += len(base)
        start, size = placed[key]
        faces.append(_faces(file, primitive, size) + start)
    shapes = np.concatenate(blocks, axis=1)
    weights = np.array(mesh.get("weights", [0.0] * (len(shapes) - 1)), dtype=np.float64)
    return _Mesh(shapes, np.concatenate(faces), weights)


def _faces(file: File, primitive: dict[str, Any], n_vertices: int) -> Ints:
    if primitive.get("mode", _TRIANGLES) != _TRIANGLES:
        return np.zeros((0, 3), dtype=np.int64)
    corners = np.arange(n_vertices, dtype=np.uint64)
    if "indices" in primitive:
        corners = file.array(primitive["indices"], 1, "faces", 3)[:, 0]
    file.hold(8 * len(corners))
    if len(corners) % 3 or corners.dtype.kind != "u":
        raise _malformed(f"Triangles in the GLB file have {len(corners)} corners.")
    if len(corners) and int(corners.max()) >= n_vertices:
        raise _malformed(
            f"A triangle of the GLB file names vertex {corners.max()} of {n_vertices}."
        )
    return corners.astype(np.int64).reshape(-1, 3)


def _placed(mesh: _Mesh, weights: Floats, M: Floats) -> Floats:
    n_targets = len(mesh.shapes) - 1
    if weights.shape[1:] != (n_targets,) or not np.isfinite(weights).all():
        raise _malformed(
            f"The GLB file has {weights.shape[-1]} weights for {n_targets} morph targets."
        )
    # x(t) = M(t) (base + sum_i w_i(t) target_i)
    moved = np.tensordot(weights, mesh.shapes[1:], axes=(1, 0)) + mesh.shapes[0]
    placed: Floats = np.matmul(moved, M[:, :3, :3].transpose(0, 2, 1))
    return placed + M[:, None, :3, 3]
