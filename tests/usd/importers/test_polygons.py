# SPDX-License-Identifier: Apache-2.0
"""Polygons of OBJ and PLY files, as Blender and other programs write them."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from tiscene.errors import StageError
from tiscene.usd.importers.mesh_file import load_model
from tiscene.usd.importers.polygons import split_polygons

# A slab of the shape of an L, of height 0.5: its top and bottom have six corners, one of them concave, its sides four.
OUTLINE = [(0.5, 0.5), (0.5, 2), (0, 2), (0, 0), (2, 0), (2, 0.5)]
POINTS = [(x, y, z) for z in (0.0, 0.5) for x, y in OUTLINE]
FACES = [[5, 4, 3, 2, 1, 0], [6, 7, 8, 9, 10, 11], *([i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6] for i in range(6))]
AREA = 2 * 1.75 + 8 * 0.5


def obj(corner="{}"):
    lines = [f"v {x} {y} {z}" for x, y, z in POINTS]
    return "\n".join([*lines, *("f " + " ".join(corner.format(each + 1) for each in face) for face in FACES)]).encode()


def ply(encoding):
    header = f"ply\nformat {encoding} 1.0\nelement vertex 12\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 8\nproperty uchar flags\nproperty list uchar uint vertex_indices\nend_header\n"
    if encoding == "ascii":
        rows = [*POINTS, *([7, len(face), *face] for face in FACES)]
        return (header + "".join(" ".join(map(str, row)) + "\n" for row in rows)).encode()
    order = "<" if encoding == "binary_little_endian" else ">"
    faces = b"".join(struct.pack(f"{order}BB{len(face)}I", 7, len(face), *face) for face in FACES)
    return header.encode() + np.array(POINTS, order + "f4").tobytes() + faces


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.obj", obj()),
        ("a.obj", obj("{0}//")),
        ("a.obj", obj().replace(b" 12 11", b" -1 -2").replace(b"f 6 5", b"f 6 \\\n5")),
        *(("a.ply", ply(encoding)) for encoding in ("ascii", "binary_little_endian", "binary_big_endian")),
    ],
)
def test_concave_polygons_keep_their_notches(name, content):
    (mesh,) = load_model(name, {name: content})
    sides = mesh.points[mesh.triangles]
    crosses = np.cross(sides[:, 1] - sides[:, 0], sides[:, 2] - sides[:, 0])
    assert len(mesh.triangles) == 20
    np.testing.assert_allclose(np.linalg.norm(crosses, axis=1).sum() / 2, AREA)


def test_a_ply_file_of_triangles_is_read_as_it_is():
    header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    header += "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    content = header.encode() + np.eye(3, dtype="<f4").tobytes() + struct.pack("<B3i", 3, 0, 1, 2)
    assert split_polygons(".ply", content) is content


def test_a_damaged_ply_file_is_refused_by_its_reader():
    with pytest.raises(StageError, match="cannot be read"):
        load_model("a.ply", {"a.ply": ply("binary_little_endian")[:-9]})
