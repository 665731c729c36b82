# SPDX-License-Identifier: Apache-2.0
"""UsdGeomMesh: faces, orientation, holes, primvars, subsets, and the problems that are reported about them."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests.usd.helpers import QUAD, STAGES, area, facing, problems_of, read, read_with_warning
from tiscene.usd.read.stage_reader import read_stage

TWO_QUADS = """
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 5, 4]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
"""


def mesh(body: str, lines: str = "", metadata: str = "") -> str:
    return f'def Mesh "M" {metadata}\n{{\n{body}\n{lines}\n}}'


def only_mesh(description):
    (result,) = description.meshes
    return result


def test_smooth_rule_of_triangles_is_named_where_there_are_some(tmp_path):
    body = """
    int[] faceVertexCounts = [%s]
    int[] faceVertexIndices = [0, 1, 2, 3, %s]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)]
    token triangleSubdivisionRule = "smooth"
    """
    only_mesh(read(tmp_path, mesh(body % ("4", ""))))
    read_with_warning(tmp_path, mesh(body % ("4, 3", "1, 4, 2")), "triangleSubdivisionRule.*</M>")


def test_quad_becomes_two_triangles(tmp_path):
    quad = only_mesh(read(tmp_path, mesh(QUAD)))
    np.testing.assert_array_equal(quad.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(quad.triangles, [[0, 1, 2], [0, 2, 3]])
    assert quad.positions.dtype == np.float32
    assert quad.triangles.dtype == np.int32
    assert quad.materials.dtype == np.int32
    assert quad.normals is None
    assert quad.uv is None


def test_arrays_own_their_memory(tmp_path):
    """They are no views of the stage's, which are freed with it."""
    normals = "normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]"
    quad = only_mesh(read(tmp_path, mesh(QUAD, normals)))
    for array in (quad.positions, quad.triangles, quad.materials, quad.normals):
        assert array.flags.c_contiguous
        while array.base is not None:
            array = array.base
        assert isinstance(array, np.ndarray)
        assert array.flags.owndata


def test_left_handed_mesh_gets_reversed_winding(tmp_path):
    quad = only_mesh(read(tmp_path, mesh(QUAD, 'uniform token orientation = "leftHanded"')))
    np.testing.assert_allclose(facing(quad.positions, quad.triangles), [[0, 0, -1], [0, 0, -1]])


def test_left_handed_subdivided_mesh_gets_negated_normals(tmp_path):
    body = mesh(QUAD.replace('"none"', '"catmullClark"'), 'uniform token orientation = "leftHanded"')
    surface = only_mesh(read(tmp_path, body))
    np.testing.assert_allclose(facing(surface.positions, surface.triangles)[:, 2], -1.0)
    np.testing.assert_allclose(surface.normals[:, 2], -1.0)


def test_hole_faces_are_dropped(tmp_path):
    two = only_mesh(read(tmp_path, mesh(TWO_QUADS, "int[] holeIndices = [0]")))
    np.testing.assert_array_equal(two.positions[:, 0].min(), 1.0)
    assert len(two.triangles) == 2
    for wrong in (2, -1):
        (problem,) = problems_of(tmp_path, mesh(TWO_QUADS, f"int[] holeIndices = [0, {wrong}]"))
        assert problem == f"</M> mesh: holeIndices refer to face {wrong}, but there are 2 (0-1)"


def test_concave_polygon_keeps_its_area(tmp_path):
    body = """
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [6]
    int[] faceVertexIndices = [0, 1, 2, 3, 4, 5]
    point3f[] points = [(0, 0, 0), (3, 0, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0), (0, 3, 0)]
    """
    shape = only_mesh(read(tmp_path, mesh(body)))
    assert area(shape.positions, shape.triangles) == pytest.approx(5.0)


NORMALS = [
    ("vertex", "[(0, 0, 2), (0, 1, 0), (1, 0, 0), (0, 0, 1)]", 4, {(0, 0): (0, 0, 1), (1, 0): (0, 1, 0)}),
    ("varying", "[(0, 0, 2), (0, 1, 0), (1, 0, 0), (0, 0, 1)]", 4, {(1, 1): (1, 0, 0)}),
    ("faceVarying", "[(0, 0, 2), (0, 1, 0), (1, 0, 0), (0, 0, 1)]", 4, {(0, 1): (0, 0, 1)}),
    ("uniform", "[(0, 1, 0)]", 4, {(0, 0): (0, 1, 0), (1, 1): (0, 1, 0)}),
    ("constant", "[(1, 0, 0)]", 4, {(0, 0): (1, 0, 0), (1, 1): (1, 0, 0)}),
]


@pytest.mark.parametrize(("interpolation", "values", "vertices", "expected"), NORMALS)
@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_normals_of_each_interpolation_reach_vertices(tmp_path, name, interpolation, values, vertices, expected):
    quad = only_mesh(read(tmp_path, mesh(QUAD, f'normal3f[] {name} = {values} (interpolation = "{interpolation}")')))
    assert len(quad.positions) == vertices
    at = {
        tuple(p[:2].astype(int).tolist()): tuple(n.tolist()) for p, n in zip(quad.positions, quad.normals, strict=True)
    }
    for point, normal in expected.items():
        assert at[point] == normal


def test_indexed_primvars_normals_take_precedence_over_normals(tmp_path):
    lines = """
    normal3f[] normals = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)]
    normal3f[] primvars:normals = [(0, 1, 0), (0, 0, 1)] (interpolation = "faceVarying")
    int[] primvars:normals:indices = [0, 0, 1, 1]
    """
    quad = only_mesh(read(tmp_path, mesh(QUAD, lines)))
    np.testing.assert_array_equal(quad.normals, [[0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]])


def test_uniform_normals_split_shared_vertices(tmp_path):
    two = only_mesh(
        read(tmp_path, mesh(TWO_QUADS, 'normal3f[] normals = [(0, 0, 1), (1, 0, 0)] (interpolation = "uniform")'))
    )
    assert len(two.positions) == 8
    np.testing.assert_array_equal(two.normals[two.triangles[:2]].reshape(-1, 3), np.tile([0, 0, 1], (6, 1)))
    np.testing.assert_array_equal(two.normals[two.triangles[2:]].reshape(-1, 3), np.tile([1, 0, 0], (6, 1)))


def test_subdivided_mesh_ignores_authored_normals(tmp_path):
    lines = "normal3f[] normals = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)]"
    surface = only_mesh(read(tmp_path, mesh(QUAD.replace('"none"', '"catmullClark"'), lines)))
    np.testing.assert_allclose(surface.normals, np.tile([0, 0, 1], (len(surface.normals), 1)), atol=1e-6)


@pytest.mark.parametrize("scheme", ["catmullClark", "loop", "bilinear", "none"])
def test_subdivision_schemes(tmp_path, scheme):
    body = mesh(QUAD.replace('"none"', f'"{scheme}"'))
    if scheme == "loop":
        surface = only_mesh(read_with_warning(tmp_path, body, "Loop subdivision.*</M>"))
    else:
        surface = only_mesh(read(tmp_path, body))
    assert (len(surface.triangles) > 2) == (scheme in ("catmullClark", "loop"))
    assert area(surface.positions, surface.triangles) == pytest.approx(1.0)


def test_default_scheme_is_catmull_clark(tmp_path):
    body = mesh(QUAD.replace('uniform token subdivisionScheme = "none"', ""))
    assert len(only_mesh(read(tmp_path, body)).triangles) > 2


UVS = [
    ('texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")', 4),
    ('float2[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")', 4),
    ('texCoord2d[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "varying")', 4),
    ('texCoord2h[] primvars:map1 = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")', 4),
]


@pytest.mark.parametrize(("line", "vertices"), UVS)
def test_texture_coordinates_of_each_type_and_interpolation(tmp_path, line, vertices):
    quad = only_mesh(read(tmp_path, mesh(QUAD, line)))
    assert len(quad.positions) == vertices
    np.testing.assert_array_equal(quad.uv, quad.positions[:, :2])
    assert quad.uv.dtype == np.float32


def test_constant_texture_coordinates_are_inherited(tmp_path):
    body = f"""def Xform "X"
{{
    texCoord2f[] primvars:st = [(0.25, 0.75)] (interpolation = "constant")
    def Mesh "M" {{ {QUAD} }}
}}"""
    np.testing.assert_array_equal(only_mesh(read(tmp_path, body)).uv, np.tile([0.25, 0.75], (4, 1)))


def test_indexed_texture_coordinates_split_vertices_at_seam(tmp_path):
    lines = """
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")
    int[] primvars:st:indices = [0, 1, 2, 3, 0, 1, 2, 3]
    """
    two = only_mesh(read(tmp_path, mesh(TWO_QUADS, lines)))
    assert len(two.positions) == 8  # the points at x = 1 have u = 1 on one side, 0 on the other
    np.testing.assert_array_equal(two.uv[two.triangles[:2]], two.positions[two.triangles[:2]][..., :2])
    np.testing.assert_array_equal(two.uv[two.triangles[2:]], two.positions[two.triangles[2:]][..., :2] - (1, 0))


def test_uniform_normals_and_vertex_uv_combine(tmp_path):
    lines = """
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)] (interpolation = "vertex")
    normal3f[] normals = [(0, 0, 1), (1, 0, 0)] (interpolation = "uniform")
    """
    two = only_mesh(read(tmp_path, mesh(TWO_QUADS, lines)))
    assert len(two.positions) == 8
    np.testing.assert_array_equal(two.uv, two.positions[:, :2])


def test_face_subsets_get_their_materials():
    description = read_stage(STAGES / "subsets.usda")
    (mesh_read,) = description.meshes
    names = [description.materials[row].name for row in mesh_read.materials]
    assert names == ["Red", "Red", "Blue", "Blue", "Gray", "Gray"]


def test_face_subsets_of_subdivided_mesh_get_their_materials(tmp_path):
    text = (
        (STAGES / "subsets.usda")
        .read_text()
        .replace('subdivisionScheme = "none"', 'subdivisionScheme = "catmullClark"')
    )
    path = tmp_path / "smooth.usda"
    path.write_text(text)
    description = read_stage(path)
    (surface,) = description.meshes
    center = surface.positions[surface.triangles].mean(axis=1)[:, 0]
    for name, low, high in (("Red", 0, 1), ("Blue", 1, 2), ("Gray", 2, 3)):
        x = center[[description.materials[row].name == name for row in surface.materials]]
        assert low <= x.min() < x.max() <= high


WRONG = [
    ("int[] faceVertexIndices = [0, 1, 2, 7]", "mesh: 1 face refers to point 7, but the mesh has 4 points (0-3)"),
    (
        "int[] faceVertexIndices = [0, -1, 9, 7]",
        "mesh: 1 face refers to point -1 and 2 other missing ones, but",
    ),
    ("int[] faceVertexIndices = [0, 1, 2]", "mesh: faceVertexCounts add up to 4, but there are 3 faceVertexIndices"),
    ("int[] faceVertexCounts = [-4]", "mesh: faceVertexCounts holds -4"),
    ("point3f[] points = []", "mesh: 1 face, but no points"),
    ("point3f[] points = [(0, 0, 0), (nan, 0, 0), (inf, 1, 0), (0, 1, 0)]", "mesh: 2 points are not finite"),
]


@pytest.mark.parametrize(("line", "expected"), WRONG)
def test_contradictory_topology_is_a_problem(tmp_path, line, expected):
    name = line.split(" = ")[0]
    kept = "\n".join(kept for kept in QUAD.split("\n") if not kept.strip().startswith(name + " "))
    (problem,) = problems_of(tmp_path, mesh(kept, line))
    assert problem.startswith(f"</M> {expected}"), problem


UNUSED = [
    ("normal3f[] normals = [(0, 0, 1)]", "normals: 1 value, but vertex interpolation needs 4"),
    ("normal3f[] normals = [(0, 0, nan), (0, 0, 1), (0, 0, 1), (0, 0, 1)]", "normals: 1 value is not finite"),
    (
        'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "faceVarying")',
        "primvars:st: 1 value, but faceVarying interpolation needs 4",
    ),
    (
        'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "faceVarying")\nint[] primvars:st:indices = [0, 0, 1, 0]',
        "primvars:st: an index refers to value 1, but it has 1 value",
    ),
    (
        'texCoord2f[] primvars:st = [(0, 0)] (interpolation = "faceVarying")\n int[] primvars:st:indices = [0, 0]',
        "primvars:st: 2 indices, but faceVarying interpolation needs 4",
    ),
    ('float[] primvars:st = [0, 1, 2, 3] (interpolation = "vertex")', "primvars:st: has values of shape (), but 2"),
]


@pytest.mark.parametrize(("line", "expected"), UNUSED)
def test_primvars_that_do_not_fit_are_reported_and_ignored(tmp_path, line, expected):
    description = read_with_warning(tmp_path, mesh(QUAD, line), re.escape(expected) + ".*so that it is not used: </M>$")
    assert description.meshes[0].uv is None
    assert description.meshes[0].normals is None


CREASES = [
    ("int[] cornerIndices = [4]\n float[] cornerSharpnesses = [1]", "cornerIndices refer to points outside 0-3"),
    ("int[] cornerIndices = [1]", "1 cornerIndices, but 0 cornerSharpnesses"),
    ("int[] creaseIndices = [0, 1]", "creaseLengths must be at least 2 and add up to 2 creaseIndices"),
    ("int[] creaseIndices = [0]\n int[] creaseLengths = [1]", "creaseLengths must be at least 2 and add up to 1"),
    (
        "int[] creaseIndices = [0, 1, 2, 3]\n int[] creaseLengths = [4]\n float[] creaseSharpnesses = [1, 2]",
        "2 creaseSharpnesses, but there must be 1 or 3",
    ),
    (
        "int[] creaseIndices = [0, 1]\n int[] creaseLengths = [2]\n float[] creaseSharpnesses = [nan]",
        "a crease or corner sharpness is not a number",
    ),
]


@pytest.mark.parametrize(("lines", "expected"), CREASES)
def test_contradictory_creases_are_problems(tmp_path, lines, expected):
    (problem,) = problems_of(tmp_path, mesh(QUAD.replace('"none"', '"catmullClark"'), lines))
    assert problem.startswith(f"</M> creases: {expected}")


def test_sharpness_per_crease_and_per_edge_agree():
    description = read_stage(STAGES / "creases.usda")
    by_name = {record.name: row for row, record in enumerate(description.objects)}
    meshes = {name: description.meshes[description.instances[row].mesh] for name, row in by_name.items()}
    np.testing.assert_array_equal(meshes["PerCrease"].positions, meshes["PerEdge"].positions)
    assert meshes["PerCrease"].positions[:, 1].max() == pytest.approx(1.0)  # the sharp loop keeps its height
    assert meshes["PerCrease"].positions[:, 1].min() > -0.9  # the smooth side has shrunk
    assert (meshes["Corner"].positions == (1, 1, 1)).all(axis=1).any()  # the sharp point stays


def test_all_problems_of_a_stage_are_raised_together():
    from tiscene.errors import StageError

    with pytest.raises(StageError) as caught:
        read_stage(STAGES / "broken.usda")
    assert caught.value.problems == (
        "</Room/Lamp/Shade> mesh: 3 faces refer to point 4, but the mesh has 4 points (0-3)",
        "</Room/Rug> transform: its transform holds numbers that are not finite",
        "</Room/Sun> light: intensity nan, exposure 0.0, color [1.0, 1.0, 1.0] is not a finite emission",
    )
    assert "has 3 problems:\n  </Room/Lamp/Shade> mesh: 3 faces" in str(caught.value)


def test_meshes_without_visible_faces_are_reported(tmp_path):
    assert not read_with_warning(tmp_path, 'def Mesh "M" {}', "a mesh without faces: </M>").instances
    body = mesh(QUAD, "int[] holeIndices = [0]")
    assert not read_with_warning(tmp_path, body, "a mesh without a visible face: </M>").instances


def test_smooth_mesh_of_whose_faces_none_remains_is_reported(tmp_path):
    """It was an error of numpy."""
    quad = QUAD.replace('"none"', '"catmullClark"')
    for lines, text in (
        ('uniform token interpolateBoundary = "none"', 'interpolateBoundary "none" leaves out every face.*</M>'),
        ("int[] holeIndices = [0]", "a mesh without a visible face: </M>"),
    ):
        assert not read_with_warning(tmp_path, mesh(quad, lines), text).instances


@pytest.mark.parametrize("family", ["materialBind", "parts"])
def test_subset_that_is_left_out_is_no_part(tmp_path, family):
    subset = """
    def GeomSubset "%s" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        uniform token elementType = "face"
        uniform token familyName = "%s"
        int[] indices = [%s]
    }"""
    lines = subset % ("Good", family, "0") + subset % ("Bad", family, "1, 7")
    two = QUAD.replace("[4]", "[3, 3]").replace("[0, 1, 2, 3]", "[0, 1, 2, 0, 2, 3]")
    description = read_with_warning(tmp_path, mesh(two, lines), "</M/Bad> subset: refers to face 7")
    assert description.objects[0].parts == ("M/Good", "M")
    assert description.meshes[0].parts.tolist() == [0, 1]


def test_subset_index_out_of_range_is_a_problem(tmp_path):
    body = mesh(
        QUAD,
        """
    def GeomSubset "S" (prepend apiSchemas = ["MaterialBindingAPI"])
    {
        uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [1]
    }""",
    )
    assert problems_of(tmp_path, body) == ("</M/S> subset: refers to face 1, but the mesh has 1 face (0-0)",)
