# SPDX-License-Identifier: Apache-2.0
"""Split the polygons of OBJ and PLY files before trimesh reads them.

trimesh makes a fan of each polygon, which covers the notches of concave ones. It counts negative indices of OBJ files
from the end of the file, not from the face, and it reads neither tabs nor comments behind numbers, nor PLY files whose
faces differ in their number of bytes. What is not understood here is left to trimesh and its error messages.
"""

from __future__ import annotations

import codecs
import re
import struct
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tiscene.usd.geometry.triangulate import Indices, triangulate

_NAMES = "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64"
_TYPES = dict(zip(_NAMES.split(), 2 * "bBhHiIfd", strict=True))  # PLY's types as those of `struct`
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_TRIANGLE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def split_polygons(suffix: str, content: bytes) -> bytes:
    """Return a model file with triangles for concave polygons, and what else trimesh would not read rightly mended.

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
    content = content.removeprefix(codecs.BOM_UTF8).replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").replace(b"\t", b" ")
    lines = content.splitlines()
    counts = {b"v": 0, b"vt": 0, b"vn": 0}  # so far
    points: list[bytes] = []  # their lines
    polygons: list[tuple[int, list[bytes]]] = []  # line, corners
    for row, line in enumerate(lines):
        if line[:1] == b" ":
            line = lines[row] = line.lstrip()
        kind = line[:2].rstrip()
        if kind != b"f" and kind not in counts:
            continue
        if b"#" in line:
            line = lines[row] = line.partition(b"#")[0]
        if kind == b"f":
            corners = line.split()[1:]
            if b"-" in line:
                corners = [_absolute(corner, counts.values()) for corner in corners]
                lines[row] = b"f " + b" ".join(corners)
            if len(corners) > 3:
                polygons.append((row, corners))
        else:
            counts[kind] += 1
            if kind == b"v":
                points.append(line)
    if polygons:
        sizes = np.array([len(corners) for _, corners in polygons])
        text = b" ".join(b" ".join(corners) for _, corners in polygons)
        indices = _numbers(re.sub(rb"/\S*", b"", text)).astype(np.int64) - 1
        places = _numbers(b" ".join(b" ".join(line.split()[1:4]) for line in points)).reshape(-1, 3)
        triangles, face, is_fan = _triangles(places, sizes, indices)
        first = np.searchsorted(face, np.arange(len(sizes) + 1))
        begin = np.cumsum(sizes) - sizes
        for number in np.flatnonzero(~is_fan).tolist():
            row, corners = polygons[number]
            split = (triangles[first[number] : first[number + 1]] - begin[number]).tolist()
            lines[row] = b"\n".join(b"f " + b" ".join(corners[each] for each in triangle) for triangle in split)
    return b"\n".join(lines) + b"\n"


def _absolute(corner: bytes, counts: Iterable[int]) -> bytes:
    """Return a corner of a face without negative indices, which count from the last of each kind so far."""
    parts = zip(corner.split(b"/"), counts, strict=False)
    return b"/".join(b"%d" % (count + 1 + int(part)) if part.startswith(b"-") else part for part, count in parts)


def _numbers(text: bytes) -> NDArray[np.float64]:
    """Return the numbers of a text."""
    return np.fromstring(text, np.float64, sep=" ")


def _triangles(
    points: NDArray[np.float64], counts: Indices, indices: Indices
) -> tuple[Indices, Indices, NDArray[np.bool_]]:
    """Split polygons.

    Returns:
        triangles: [m, 3], as positions in `indices`.
        face: [m], the polygon of each.
        is_fan: [polygons], whether the triangles of each are a fan.
    """
    triangles, face = triangulate(points, counts, indices)
    sizes = np.maximum(counts - 2, 0)
    step = np.arange(len(face)) - (np.cumsum(sizes) - sizes)[face]
    fan = (np.cumsum(counts) - counts)[face, None] + np.stack([0 * step, step + 1, step + 2], axis=1)
    is_fan = np.ones(len(counts), bool)
    is_fan[face[(triangles != fan).any(axis=1)]] = False
    return triangles, face, is_fan


class _Element(NamedTuple):
    """An element of a PLY file.

    Attributes:
        name: "vertex", "face" or another one.
        size: how many there are.
        properties: their names, each with its type, or "list" and the types of the length and of the values.
    """

    name: str
    size: int
    properties: list[tuple[str, list[str]]]


def face_properties(content: bytes) -> list[str]:
    """Return the names of further lists of the faces of a PLY file, and of their colors: what is not read."""
    faces = [each for each in _elements(content.partition(b"end_header")[0])[1] if each.name == "face"]
    names = [name for each in faces for name, kinds in each.properties]
    lists = [name for each in faces for name, kinds in each.properties if kinds[0] == "list"]
    return [name for name in names if name in (*lists[1:], "red", "green", "blue")]


def _elements(header: bytes) -> tuple[str, list[_Element]]:
    """Return the encoding of a PLY file and its elements."""
    encoding, elements = "", list[_Element]()
    for words in map(str.split, header.decode("latin-1").splitlines()):
        match words:
            case ["format", encoding, *_]:
                pass
            case ["element", name, number]:
                elements.append(_Element(name, int(number), []))
            case ["property", *kinds, name] if elements:
                elements[-1].properties.append((name, kinds))
    return encoding, elements


def _split_ply(content: bytes) -> bytes:
    end = re.search(rb"end_header\r?\n", content)
    encoding, elements = _elements(content[: end.end()]) if end else ("", [])
    if end is None or [each.name for each in elements[:2]] != ["vertex", "face"]:
        return content
    order, at, (vertex, face) = _ORDERS[encoding], end.end(), elements[:2]
    types = [(name, _TYPES[kind]) for name, (kind,) in vertex.properties]
    lists = [kinds for _, kinds in face.properties if kinds[0] == "list"]
    vertices = np.empty(vertex.size, [(name, f"<{kind}") for name, kind in types])
    if order:
        vertices[:] = np.frombuffer(content, [(name, order + kind) for name, kind in types], vertex.size, at)
        kinds = [[_TYPES[kind] for kind in each if kind != "list"] for _, each in face.properties]
        heads = [struct.Struct(order + first) for first, *_ in kinds]
        steps = [(head.size, sum(map(struct.calcsize, rest))) for head, (_, *rest) in zip(heads, kinds, strict=True)]
        at += vertices.nbytes
        counts, places = _corners(face.size, at, steps, lambda row, at: heads[row].unpack_from(content, at)[0])
        corner = np.dtype(order + _TYPES[lists[0][2]])
        words = np.frombuffer(content, np.uint8)[places[:, None] + np.arange(corner.itemsize)]
        indices = words.view(corner)[:, 0].astype(np.int64)
    else:
        numbers = _numbers(content[at:])
        at = vertex.size * len(types)
        for (name, _), values in zip(types, numbers[:at].reshape(-1, len(types)).T, strict=True):
            vertices[name] = values
        steps = [(1, int(kinds[0] == "list")) for _, kinds in face.properties]
        counts, places = _corners(face.size, at, steps, lambda _, at: int(numbers[at]))
        indices = numbers[places].astype(np.int64)
    points = np.stack([vertices[axis].astype(np.float64) for axis in "xyz"], axis=1)
    triangles, _, is_fan = _triangles(points, counts, indices)
    if is_fan.all() and len(lists) == 1 and not (order and len(set(counts.tolist())) > 1):
        return content
    rows = np.full(len(triangles), 3, _TRIANGLE)
    rows["corners"] = indices[triangles]
    header = re.split(rb"(?m)^element\s+face\s", content[: end.end()])[0]
    header = re.sub(rb"format\s+\w+", b"format binary_little_endian", header)
    header += b"element face %d\nproperty list uchar int vertex_indices\nend_header\n" % len(rows)
    return header + vertices.tobytes() + rows.tobytes()


def _corners(
    faces: int, at: int, steps: Sequence[tuple[int, int]], length: Callable[[int, int], int]
) -> tuple[Indices, Indices]:
    """Find the corners of faces, which are the first list of each.

    Args:
        faces: number of faces.
        at: place of the first face, in bytes or in numbers of a text.
        steps: of each property of a face, the size of its value, or of the length of its list, and that of each value
            of the list, 0 for no list.
        length: returns the length of a list, given the row of the property and its place.

    Returns:
        The number of corners of each face, and the places of all corners.
    """
    main = [size > 0 for _, size in steps].index(True)
    begins, counts = list[int](), list[int]()
    for _ in range(faces):
        for row, (head, size) in enumerate(steps):
            count = length(row, at) if size else 0
            at += head
            if row == main:
                begins.append(at)
                counts.append(count)
            at += count * size
    sizes, step = np.array(counts, np.int64), steps[main][1]
    starts = np.array(begins, np.int64) - step * (np.cumsum(sizes) - sizes)
    return sizes, np.repeat(starts, sizes) + step * np.arange(sizes.sum())
