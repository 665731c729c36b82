# SPDX-License-Identifier: Apache-2.0
"""The triangle budget of a stage's subdivision surfaces: which are refined less, and by how much."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import ArgumentError, StageWarning
from tiscene.usd.read.stage_reader import read_stage

FACES = "[0, 1, 3, 2, 2, 3, 5, 4, 4, 5, 7, 6, 6, 7, 1, 0, 1, 7, 5, 3, 6, 0, 2, 4]"


def box(name: str, at: str, size: float = 1.0, more: str = "") -> str:
    """Return a cube of 6 faces and 24 corners: it is smooth after 4 levels (90 degrees / 2^4 < 8), 3,072 triangles."""
    h = size / 2
    corners = ", ".join(f"({x}, {y}, {z})" for y, z in ((-h, h), (h, h), (h, -h), (-h, -h)) for x in (-h, h))
    return f"""def Mesh "{name}"
{{
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = {FACES}
    point3f[] points = [{corners}]
    double3 xformOp:translate = {at}
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {more}
}}
"""


CAMERA = 'def Camera "C"\n{\n}\n'  # at the origin, with USD's default lens
NEAR, FAR = box("Near", "(0, 0, -4)"), box("Far", "(0, 0, -100)", 1.5)


def triangles(path, budget=None):
    """Return the number of triangles of each object, and the texts of the warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        description = read_stage(path, subdivision=budget)
    rows = {description.objects[each.object].name: each.mesh for each in description.instances}
    counts = {name: len(description.meshes[row].triangles) for name, row in rows.items()}
    return counts, [str(each.message) for each in caught], description


def test_surfaces_within_the_budget_are_smooth_and_nothing_is_named(tmp_path):
    path = write(tmp_path, CAMERA + NEAR + FAR)
    counts, warned, _ = triangles(path)
    assert warned == []
    assert counts["Near"] == counts["Far"] > 24 * 2 * 4


def test_surfaces_far_from_the_camera_are_reduced_first(tmp_path):
    path = write(tmp_path, CAMERA + NEAR + FAR)
    smooth = triangles(path)[0]["Near"]
    counts, warned, _ = triangles(path, smooth + 100)
    assert counts["Near"] == smooth
    assert counts["Far"] in (12, 48)
    (text,) = warned
    assert "1 of 2 different subdivision surfaces are refined less than smooth" in text
    assert f"(subdivision={smooth + 100:,}): </Far>" in text


def test_larger_surfaces_keep_more_triangles_without_a_camera(tmp_path):
    counts, warned, _ = triangles(
        write(tmp_path, box("Small", "(0, 0, -4)", 0.01) + box("Large", "(0, 0, -9)", 5)), 900
    )
    assert counts["Large"] > counts["Small"]
    assert len(warned) == 1


@pytest.mark.parametrize("budget", [24, 100, 500, 2000])
def test_total_stays_within_the_budget(tmp_path, budget):
    counts, _, _ = triangles(write(tmp_path, CAMERA + NEAR + FAR), budget)
    assert sum(counts.values()) <= budget


def test_surface_without_refinement_lies_on_the_limit_surface(tmp_path):
    """Of a cube's corner; see the rules of Catmull and Clark for a point where three quadrilaterals meet."""
    counts, _, description = triangles(write(tmp_path, box("A", "(0, 0, 0)", 2.0)), 0)
    (mesh,) = description.meshes
    assert counts == {"A": 12}
    limit = (9 * 1 + 4 * 1 + (-1)) / 24  # per axis: neighbors add 1 + 1 - 1, diagonals 1 - 1 - 1
    np.testing.assert_allclose(np.abs(mesh.positions), limit, atol=1e-6)
    np.testing.assert_allclose(np.abs(mesh.normals), 1 / np.sqrt(3), atol=1e-6)


def test_equal_copies_count_once_and_share_a_mesh(tmp_path):
    copies = "".join(box(f"Copy{row}", f"({3 * row}, 0, -9)") for row in range(5))
    smooth = triangles(write(tmp_path, CAMERA + box("Copy0", "(0, 0, -9)")))[0]["Copy0"]
    counts, warned, description = triangles(write(tmp_path, CAMERA + copies), smooth)
    assert warned == []
    assert len(description.meshes) == 1
    assert set(counts.values()) == {smooth}


def test_points_of_instancers_count_where_they_are(tmp_path):
    """The prototype itself is far away; one of its points is near the camera."""
    body = f"""def PointInstancer "P"
{{
    rel prototypes = </P/Chair>
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 97), (0, 50, 0)]
    {FAR.replace('"Far"', '"Chair"').replace("1.5", "1.0")}
}}
"""
    path = write(tmp_path, CAMERA + body + box("Middle", "(0, 0, -50)", 0.9))
    smooth = triangles(write(tmp_path, NEAR, name="one.usda"))[0]["Near"]
    counts, _, _ = triangles(path, smooth + 100)
    assert counts["P[0]"] == counts["P[1]"] == smooth
    assert counts["Middle"] < smooth


def test_hidden_surfaces_do_not_count(tmp_path):
    smooth = triangles(write(tmp_path, CAMERA + NEAR))[0]["Near"]
    hidden = FAR.replace("{", '{\ntoken visibility = "invisible"', 1)
    assert triangles(write(tmp_path, CAMERA + NEAR + hidden), smooth)[1] == []


def test_contradictory_surfaces_are_left_to_the_reader(tmp_path):
    bad = box("Bad", "(0, 0, 0)", 1.0).replace("[4, 4, 4, 4, 4, 4]", "[4, 4]")
    counts, warned, _ = triangles(write(tmp_path, CAMERA + NEAR + bad), 10)
    assert set(counts) == {"Near"}
    assert "</Bad> mesh: faceVertexCounts add up to 8" in warned[0]


def test_budget_is_an_argument_of_streams(tmp_path):
    path = write(tmp_path, CAMERA + NEAR)
    with pytest.raises(ArgumentError, match="subdivision=-1"):
        ts.Stream(path, subdivision=-1)
    with pytest.warns(StageWarning, match="refined less than smooth"):
        stream = ts.Stream(path, width=8, height=6, buffers=("depth",), subdivision=12)
    with stream:
        assert len(stream.world.stage.meshes[0].triangles) == 12
        assert stream.settings()["subdivision"] == 12
