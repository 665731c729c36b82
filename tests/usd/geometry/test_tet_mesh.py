# SPDX-License-Identifier: Apache-2.0
"""UsdGeomTetMesh as the triangles of its surface."""

from __future__ import annotations

import numpy as np
import pytest

from tests.usd.helpers import problems_of, read, read_with_warning, volume

# Two tetrahedra of volume 1/6 that share the face of points 1, 2 and 3 of (0, 0, 0), x, y, z and (1, 1, 1): 1/2 in all.
POINTS = "[(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]"
TETS = "int4[] tetVertexIndices = [(0, 1, 2, 3), (1, 2, 3, 4)]"
MIRRORED = 'int4[] tetVertexIndices = [(0, 2, 1, 3), (2, 1, 3, 4)]\nuniform token orientation = "leftHanded"'
AUTHORED = "int3[] surfaceFaceVertexIndices = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 4), (2, 3, 4), (1, 4, 3)]"
BODY = 'def TetMesh "Jelly"\n{\n    point3f[] points%s\n    %s\n}\n'


@pytest.mark.parametrize("tets", [TETS, MIRRORED, AUTHORED])
def test_surface_of_tetrahedra_faces_outward(tmp_path, tets):
    (mesh,) = read(tmp_path, BODY % (f" = {POINTS}", tets), meters=0.5).meshes
    assert len(mesh.triangles) == 6
    assert volume(mesh.positions, mesh.triangles) == pytest.approx(0.5 / 8.0)


def test_colors_of_tetrahedra_are_those_of_the_whole(tmp_path):
    color = "color3f[] primvars:displayColor = [(1, 0, 0)]"
    description = read(tmp_path, BODY % (f" = {POINTS}", f"{TETS}\n{color}"))
    assert [description.materials[row].diffuse_color for row in description.meshes[0].materials] == [(1, 0, 0)] * 6


def test_moving_points_of_tetrahedra_play(tmp_path):
    samples = f".timeSamples = {{ 0: {POINTS}, 24: {POINTS.replace('1', '2')} }}"
    (mesh,) = read(tmp_path, BODY % (samples, TETS)).meshes
    volumes = [volume(positions, mesh.triangles) for positions in mesh.deformation.positions]
    np.testing.assert_allclose(volumes, [0.5, 4.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("points", "reason"), [("[(0, 0, 0)]", "refers to point 4"), (POINTS.replace("1", "inf", 1), "not a finite number")]
)
def test_tetrahedra_that_contradict_themselves_are_problems(tmp_path, points, reason):
    (problem,) = problems_of(tmp_path, BODY % (f" = {points}", TETS))
    assert reason in problem


def test_tetrahedra_without_a_surface_are_reported(tmp_path):
    read_with_warning(
        tmp_path, BODY % (f" = {POINTS}", "") + 'def Cube "C"\n{\n}\n', "TetMesh without anything to draw"
    )


@pytest.mark.parametrize(("interpolation", "count"), [("vertex", 5), ("uniform", 6), ("faceVarying", 18)])
@pytest.mark.parametrize("tets", [AUTHORED, AUTHORED + '\nuniform token orientation = "leftHanded"'])
def test_colors_of_tetrahedra_are_those_of_points_faces_and_corners(tmp_path, interpolation, count, tets):
    """They are equal to those of a mesh of the same faces."""
    colors = [tuple(each) for each in np.random.default_rng(5).uniform(size=(count, 3)).round(3).tolist()]
    color = f'color3f[] primvars:displayColor = {colors} (interpolation = "{interpolation}")'
    faces = AUTHORED[AUTHORED.index("[(") :].replace("(", "").replace(")", "")
    mesh = f"""def Mesh "M"
{{
    uniform token subdivisionScheme = "none"
    point3f[] points = {POINTS}
    int[] faceVertexIndices = {faces}
    int[] faceVertexCounts = [3, 3, 3, 3, 3, 3]
    {color}
    {"uniform token orientation" + tets.partition("orientation")[2] if "left" in tets else ""}
}}
"""
    description = read(tmp_path, BODY % (f" = {POINTS}", f"{tets}\n{color}") + mesh)
    found = []
    for each in description.instances:
        read_mesh = description.meshes[each.mesh]
        looks = [description.materials[row].diffuse_color for row in read_mesh.materials]
        at = read_mesh.positions[read_mesh.triangles]
        found.append((at, looks if read_mesh.colors is None else read_mesh.colors[read_mesh.triangles]))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_array_equal(found[0][1], found[1][1])
