# SPDX-License-Identifier: Apache-2.0
"""Split the polygons of OBJ and PLY files before trimesh reads them.

trimesh makes a fan of each polygon, which covers the notches of concave ones, and reads no binary PLY file whose
polygons differ in their number of corners. What is not understood here is left to trimesh and its error messages.
"""

from __future__ import annotations

import re
import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.triangulate import Indices, triangulate

_NAMES = "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64"
_TYPES = dict(zip(_NAMES.split(), 2 * "bBhHiIfd", strict=True))  # PLY's types as those of `struct`


def split_polygons(suffix: str, content: bytes) -> bytes:
    """Return a model file with triangles for concave polygons, and for all of a PLY file where trimesh needs that.

    Args:
        suffix: ".obj" or ".ply"; files of other formats are returned as they are.
        content: of the file.
    """
    split = {".obj": _split_obj, ".ply": _split_ply}.get(suffix)
    try:
        return content if split is None else split(content)
    except (ValueError, IndexError, KeyError, struct.error):
        return content


def _split_obj(content: bytes) -> bytes:
    lines = re.sub(rb"\\\r?\n", b" ", content).splitlines()
    points: list[bytes] = []
    polygons: list[tuple[int, list[bytes], int]] = []  # line, corners, number of points so far
    for row, line in enumerate(lines):
        if line.startswith(b"v "):
            points += line.split()[1:4]
        elif line.startswith(b"f ") and len(corners := line.split()) > 4:
            polygons.append((row, corners[1:], len(points) // 3))
    if not polygons:
        return content
    counts = np.array([len(corners) for _, corners, _ in polygons])
    text = b" ".join(b" ".join(corners) for _, corners, _ in polygons)
    indices = _numbers(re.sub(rb"/\S*", b"", text)).astype(np.int64)
    relative = np.repeat([number for _, _, number in polygons], counts)
    indices = np.where(indices > 0, indices - 1, indices + relative)
    triangles, first, is_fan = _triangles(_numbers(b" ".join(points)).reshape(-1, 3), counts, indices)
    if is_fan.all():
        return content
    for number in np.flatnonzero(~is_fan).tolist():
        row, corners, _ = polygons[number]
        split = triangles[first[number] : first[number + 1]].tolist()
        lines[row] = b"\n".join(b"f " + b" ".join(corners[each] for each in triangle) for triangle in split)
    return b"\n".join(lines) + b"\n"


def _numbers(text: bytes) -> NDArray[np.float64]:
    """Return the numbers of a text."""
    return np.fromstring(text, np.float64, sep=" ")


def _triangles(
    points: NDArray[np.float64], counts: Indices, indices: Indices
) -> tuple[Indices, Indices, NDArray[np.bool_]]:
    """Split polygons.

    Returns:
        triangles: [m, 3], as positions among the corners of their polygon.
        first: [polygons + 1], row of the first triangle of each, and m.
        is_fan: [polygons], whether the triangles of each are a fan.
    """
    corners, face = triangulate(points, counts, indices)
    first = np.append(0, np.cumsum(np.maximum(counts - 2, 0)))
    triangles = corners - (np.cumsum(counts) - counts)[face, None]
    step = np.arange(len(face)) - first[face]
    is_fan = np.ones(len(counts), bool)
    is_fan[face[(triangles != np.stack([0 * step, step + 1, step + 2], axis=1)).any(axis=1)]] = False
    return triangles, first, is_fan


class _PlyLayout(NamedTuple):
    """What the header of a PLY file says of its vertices and faces.

    Attributes:
        order: byte order as of `struct`; "" for a text.
        vertices: number of vertices.
        vertex: type of a vertex.
        faces: number of faces.
        before: types of the values of a face before the number of its corners.
        number: type of that number.
        corner: type of the corners.
        after: types of the values after them.
    """

    order: str
    vertices: int
    vertex: np.dtype[Any]
    faces: int
    before: str
    number: str
    corner: str
    after: str


class _PlyFace(NamedTuple):
    """A face as it is in the file: its corners, and its other values before and after them."""

    before: bytes
    corners: list[bytes]
    after: bytes


def _split_ply(content: bytes) -> bytes:
    end = re.search(rb"end_header\r?\n", content)
    layout = _layout(content[: end.end()].decode("latin-1")) if end else None
    if end is None or layout is None or _has_only_triangles(content, end.end(), layout):
        return content
    start, points, faces, stop = (_read_binary if layout.order else _read_text)(content, end.end(), layout)
    counts = np.array([len(face.corners) for face in faces])
    joined = b"".join(corner for face in faces for corner in face.corners)
    kind = layout.order + layout.corner
    indices = np.frombuffer(joined, kind).astype(np.int64) if layout.order else np.array(joined.split(), np.int64)
    triangles, first, is_fan = _triangles(points, counts, indices)
    if is_fan.all() and (not layout.order or len(set(counts.tolist())) < 2):
        return content
    three = struct.pack(layout.order + layout.number, 3) if layout.order else b"3 "
    rows = [
        face.before + three + b"".join(face.corners[each] for each in triangle) + face.after
        for number, face in enumerate(faces)
        for triangle in triangles[first[number] : first[number + 1]].tolist()
    ]
    header = re.sub(rb"(element\s+face\s+)\d+", rb"\g<1>%d" % len(rows), content[: end.end()])
    return header + content[end.end() : start] + b"".join(rows) + content[stop:]


def _layout(header: str) -> _PlyLayout | None:
    """Return the layout of a file of vertices, then faces with one list each; None for other files."""
    encoding, names, rows, types = "", list[str](), list[int](), list[list[tuple[str, list[str]]]]()
    for words in map(str.split, header.splitlines()):
        match words:
            case ["format", encoding, *_]:
                pass
            case ["element", name, number]:
                names.append(name)
                rows.append(int(number))
                types.append([])
            case ["property", *kinds, name]:
                types[-1].append((name, kinds))
    if names[:2] != ["vertex", "face"]:
        return None
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}.get(encoding, "")
    vertex = np.dtype([(name, order + _TYPES[kind]) for name, (kind,) in types[0]])
    before, after = "", ""
    lists = list[str]()
    for _, kinds in types[1]:
        if kinds[0] == "list":
            lists += kinds[1:]
        elif lists:
            after += _TYPES[kinds[0]]
        else:
            before += _TYPES[kinds[0]]
    count, corner = (_TYPES[kind] for kind in lists)
    return _PlyLayout(order, rows[0], vertex, rows[1], before, count, corner, after)


def _has_only_triangles(content: bytes, start: int, layout: _PlyLayout) -> bool:
    """Return whether a binary file has only triangles, without reading them one by one."""
    if not layout.order:
        return False
    types = (layout.before, layout.number, 3 * layout.corner, layout.after)
    sizes = [struct.calcsize(layout.order + each) for each in types]
    start += layout.vertices * layout.vertex.itemsize
    if len(content) < start + layout.faces * sum(sizes):
        return False
    rows = np.frombuffer(content, np.uint8, layout.faces * sum(sizes), start).reshape(layout.faces, -1)
    three = np.frombuffer(struct.pack(layout.order + layout.number, 3), np.uint8)
    return bool((rows[:, sizes[0] : sizes[0] + sizes[1]] == three).all())


def _read_binary(
    content: bytes, start: int, layout: _PlyLayout
) -> tuple[int, NDArray[np.float64], list[_PlyFace], int]:
    """Return where the faces of a binary file start, its points, its faces, and where these end."""
    vertices = np.frombuffer(content, layout.vertex, layout.vertices, start)
    start = at = start + vertices.nbytes
    before, after = (struct.calcsize(layout.order + types) for types in (layout.before, layout.after))
    count, size = struct.Struct(layout.order + layout.number), struct.calcsize(layout.order + layout.corner)
    faces = []
    for _ in range(layout.faces):
        first = at + before + count.size
        last = first + size * count.unpack_from(content, at + before)[0]
        corners = [content[each : each + size] for each in range(first, last, size)]
        faces.append(_PlyFace(content[at : at + before], corners, content[last : last + after]))
        at = last + after
    return start, np.stack([vertices[axis].astype(np.float64) for axis in "xyz"], axis=1), faces, at


def _read_text(content: bytes, start: int, layout: _PlyLayout) -> tuple[int, NDArray[np.float64], list[_PlyFace], int]:
    """Return the same of a text; each value of a face has the space behind it."""
    lines = content[start:].splitlines(keepends=True)
    names = list(layout.vertex.names or ())
    values = np.array([line.split() for line in lines[: layout.vertices]], np.float64)
    chosen = lines[layout.vertices : layout.vertices + layout.faces]
    faces, before = [], len(layout.before)
    for words in ([word + b" " for word in line.split()] for line in chosen):
        first = before + 1
        last = first + int(words[before])
        faces.append(_PlyFace(b"".join(words[:before]), words[first:last], b"".join(words[last:]) + b"\n"))
    begin = start + sum(map(len, lines[: layout.vertices]))
    return begin, values[:, [names.index(axis) for axis in "xyz"]], faces, begin + sum(map(len, chosen))
