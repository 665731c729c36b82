# SPDX-License-Identifier: Apache-2.0
"""Polygons of OBJ and PLY files, as Blender and other programs write them."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from tiscene.errors import StageError, StageWarning
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


SQUARE = [b"v 0 0 0", b"v 1 0 0", b"v 1 1 0", b"v 0 1 0"]


@pytest.mark.parametrize(
    "text",
    [
        b"\n".join([*SQUARE, b"f 1 2 3 4 # a quad"]),
        b"\n".join([*SQUARE, b"f 1 2\\", b"3 4"]),
        b"\n".join(SQUARE).replace(b" 0\n", b" 0 # a corner\n") + b"\nf 1 2 3 4\n",
        b"\n".join([*SQUARE, b"f 1 2 3 4"]).replace(b" ", b"\t"),
        b"\n".join(b"  " + line for line in (*SQUARE, b"f 1 2 3 4")),
        b"\r".join([*SQUARE, b"f 1 2 3 4"]),
        b"\xef\xbb\xbf" + b"\n".join([*SQUARE, b"f 1 2 3 4"]),
    ],
)
def test_comments_tabs_continuations_and_other_ends_of_lines_are_read(text):
    (mesh,) = load_model("a.obj", {"a.obj": text})
    np.testing.assert_array_equal(sorted(mesh.points.tolist()), [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, 1, 0)])
    assert len(mesh.triangles) == 2


def test_negative_indices_count_from_the_vertices_before_the_face():
    """trimesh counts them from the end of the file: both squares were the second one."""
    corner = b"{0}/{0}/-1"
    face = b"f " + b" ".join(corner.replace(b"{0}", b"-%d" % each) for each in (4, 3, 2, 1))
    coordinates = [b"vt 0 0", b"vt 1 0", b"vt 1 1", b"vt 0 1", b"vn 0 0 1"]
    moved = [line.replace(b"v 0", b"v 5").replace(b"v 1", b"v 6") for line in SQUARE]
    text = b"\n".join(
        [*SQUARE, *coordinates, face, *moved, *(line.replace(b"1", b"0.5") for line in coordinates), face]
    )
    (mesh,) = load_model("a.obj", {"a.obj": text})
    corners = mesh.points[mesh.triangles].reshape(-1, 3)
    assert sorted({tuple(each) for each in corners[:, :2].tolist()}) == [
        (0, 0), (0, 1), (1, 0), (1, 1), (5, 0), (5, 1), (6, 0), (6, 1),
    ]  # fmt: skip
    uv = mesh.uv[mesh.triangles].reshape(-1, 2)
    assert [uv[corners[:, 0] < 5].max(), uv[corners[:, 0] >= 5].max()] == [1.0, 0.5]


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_ply_files_with_further_lists_and_elements_are_read(encoding):
    """MeshLab writes texture coordinates of each corner. Faces of fewer than three corners are nothing."""
    faces = [*FACES, [0, 1], []]
    header = f"ply\nformat {encoding} 1.0\ncomment element face 3\nelement vertex 12\n"
    header += "".join(f"property double {axis}\n" for axis in "zxy") + "property uchar red\n"
    header += f"element face {len(faces)}\nproperty list int uint vertex_index\nproperty list uchar float texcoord\n"
    header += "property float quality\nelement edge 1\nproperty int vertex1\nend_header\r\n"
    if encoding == "ascii":
        rows = [(z, x, y, 9) for x, y, z in POINTS]
        rows += [(len(face), *face, 2 * len(face), *face, *face, 0.5) for face in faces]
        body = ("".join(" ".join(map(str, row)) + "\n" for row in rows) + "0\n").encode()
    else:
        order = "<" if encoding == "binary_little_endian" else ">"
        body = b"".join(struct.pack(f"{order}3dB", z, x, y, 9) for x, y, z in POINTS)
        for face in faces:
            body += struct.pack(f"{order}i{len(face)}I", len(face), *face)
            body += struct.pack(f"{order}B{2 * len(face)}ff", 2 * len(face), *face, *face, 0.5)
        body += struct.pack(f"{order}i", 0)
    with pytest.warns(StageWarning, match=r"not imported: values of faces \(texcoord\)"):
        (mesh,) = load_model("a.ply", {"a.ply": header.encode() + body})
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
