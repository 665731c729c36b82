# SPDX-License-Identifier: Apache-2.0
"""Parametric gprims: sizes, axes, winding, normals, uv."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.usd.helpers import area, facing, preview_material, problems_of, read, read_with_warning, volume

CLOSED = [
    ('def Cube "G" { double size = 3 }', 27.0, 54.0),
    ('def Sphere "G" { double radius = 2 }', 32.0 * math.pi / 3.0, 16.0 * math.pi),
    ('def Cylinder "G" { double radius = 2\n double height = 3 }', 12.0 * math.pi, 20.0 * math.pi),
    ('def Cone "G" { double radius = 3\n double height = 4 }', 12.0 * math.pi, 24.0 * math.pi),
    ('def Capsule "G" { double radius = 1\n double height = 3 }', 13.0 * math.pi / 3.0, 10.0 * math.pi),
    ('def Cylinder_1 "G" { double radiusTop = 1\n double radiusBottom = 2\n double height = 3 }', 7.0 * math.pi, None),
    (
        'def Capsule_1 "G" { double radiusTop = 1\n double radiusBottom = 1\n double height = 3 }',
        13.0 * math.pi / 3,
        None,
    ),
]


def closed_lines(text: str) -> str:
    """Put closing braces on lines of their own, as USD's parser requires."""
    return text.replace(" }", "\n}")


@pytest.mark.parametrize(("text", "expected_volume", "expected_area"), CLOSED)
def test_closed_gprims_have_exact_volume_area_and_outward_normals(tmp_path, text, expected_volume, expected_area):
    (mesh,) = read(tmp_path, closed_lines(text)).meshes
    assert volume(mesh.positions, mesh.triangles) == pytest.approx(expected_volume, rel=0.006)
    if expected_area:
        assert area(mesh.positions, mesh.triangles) == pytest.approx(expected_area, rel=0.006)
    flat = facing(mesh.positions, mesh.triangles)
    for corner in range(3):  # vertex normals are close to the triangle's
        assert np.einsum("ij,ij->i", mesh.normals[mesh.triangles[:, corner]], flat).min() > 0.98
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)
    assert mesh.uv.min() >= 0.0
    assert mesh.uv.max() <= 1.0


@pytest.mark.parametrize(("axis", "column"), [("X", 0), ("Y", 1), ("Z", 2)])
@pytest.mark.parametrize("kind", ["Cylinder", "Cone", "Capsule"])
def test_axis_attribute_orients_gprim(tmp_path, kind, axis, column):
    body = f'def {kind} "G" {{ uniform token axis = "{axis}"\n double height = 6\n double radius = 1 }}'
    (mesh,) = read(tmp_path, closed_lines(body)).meshes
    extent = np.full(3, 1.0)
    extent[column] = 4.0 if kind == "Capsule" else 3.0
    np.testing.assert_allclose(mesh.positions.max(axis=0), extent, atol=1e-6)
    np.testing.assert_allclose(mesh.positions.min(axis=0), -extent, atol=1e-6)
    assert volume(mesh.positions, mesh.triangles) > 0.0
    if kind == "Cone":  # the apex is at the positive end
        apex = mesh.positions[mesh.positions[:, column] > 2.99]
        np.testing.assert_allclose(np.delete(apex, column, axis=1), 0.0, atol=1e-6)


def test_cylinder_axis_defaults_to_z(tmp_path):
    (mesh,) = read(tmp_path, 'def Cylinder "G" {}').meshes
    np.testing.assert_allclose(mesh.positions.max(axis=0), (1, 1, 1), atol=1e-6)  # radius 1, height 2


@pytest.mark.parametrize(
    ("axis", "extent", "normal"),
    [("X", (0, 2, 1), (1, 0, 0)), ("Y", (1, 0, 2), (0, 1, 0)), ("Z", (1, 2, 0), (0, 0, 1))],
)
def test_plane_faces_along_its_axis(tmp_path, axis, extent, normal):
    body = f'def Plane "G" {{ uniform token axis = "{axis}"\n double width = 2\n double length = 4 }}'
    (mesh,) = read(tmp_path, closed_lines(body)).meshes
    np.testing.assert_allclose(mesh.positions.max(axis=0), extent)
    np.testing.assert_allclose(mesh.positions.min(axis=0), np.negative(extent))
    np.testing.assert_allclose(facing(mesh.positions, mesh.triangles), [normal, normal])
    np.testing.assert_allclose(mesh.normals, np.tile(normal, (4, 1)))


def test_invalid_sizes_are_problems(tmp_path):
    (problem,) = problems_of(tmp_path, closed_lines('def Sphere "Ball" { double radius = -1 }'))
    assert problem == "</Ball> sphere: radius is -1.0"
    (problem,) = problems_of(tmp_path, closed_lines('def Cube "Box" { double size = nan }'))
    assert problem == "</Box> cube: size is nan"


@pytest.mark.parametrize(
    "size", ["Cube:size", "Sphere:radius", "Cylinder:radius", "Cylinder:height", "Cone:radius", "Capsule:radius"]
)
def test_gprim_that_grows_from_nothing_deforms(tmp_path, size):
    kind, name = size.split(":")
    sized = f'def {kind} "%s"\n{{\n    double {name}%s\n}}\n'
    body = sized % ("G", ".timeSamples = { 0: 0, 10: 2 }") + sized % ("Full", " = 2")
    grown, full = read(tmp_path, body, more="timeCodesPerSecond = 10").meshes
    np.testing.assert_allclose(grown.deformation.at(1.0)[0], full.positions, atol=1e-6)
    assert volume(*np.float64(grown.deformation.at(0.0)[:1]), grown.triangles) == pytest.approx(0.0, abs=1e-20)


def test_capsule_of_two_radii_is_reported(tmp_path):
    body = closed_lines('def Capsule_1 "G" { double radiusTop = 1\n double radiusBottom = 2 }')
    assert len(read_with_warning(tmp_path, body, "two radii.*</G>").meshes) == 1


def test_equal_gprims_share_a_mesh(tmp_path):
    body = closed_lines('def Sphere "A" { double radius = 2 }\ndef Sphere "B" { double radius = 2 }\ndef Sphere "C" {}')
    description = read(tmp_path, body)
    assert [instance.mesh for instance in description.instances] == [0, 0, 1]
    assert [record.name for record in description.objects] == ["A", "B", "C"]


# Hydra's mesh of a cube of size 2, and of a plane of width and length 2.
CUBE_POINTS = "(1,1,1), (-1,1,1), (-1,-1,1), (1,-1,1), (-1,-1,-1), (-1,1,-1), (1,1,-1), (1,-1,-1)"
CUBE_INDICES = "0,1,2,3, 4,5,6,7, 0,6,5,1, 4,7,3,2, 0,3,7,6, 4,2,1,5"
MESHES = {
    "Cube": f"point3f[] points = [{CUBE_POINTS}]\n int[] faceVertexIndices = [{CUBE_INDICES}]\n"
    "int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]",
    "Plane": "point3f[] points = [(1,1,0), (-1,1,0), (-1,-1,0), (1,-1,0)]\n int[] faceVertexIndices = [0,1,2,3]\n"
    "int[] faceVertexCounts = [4]",
}
COUNTS = {"Cube": {"uniform": 6, "vertex": 8, "varying": 8, "faceVarying": 24}, "Plane": {"uniform": 1, "vertex": 4}}


def corner_values(description, instance):
    """Return place, color and uv of each triangle corner of an instance, sorted."""
    mesh = description.meshes[description.instances[instance].mesh]
    at = mesh.triangles.reshape(-1)
    looks = [description.materials[row].diffuse_color for row in np.repeat(mesh.materials, 3)]
    colors = mesh.colors[at][:, :3] if mesh.colors is not None else np.array(looks)
    centers = np.repeat(mesh.positions[mesh.triangles].mean(axis=1) @ [9, 3, 1], 3)
    rows = np.column_stack([np.round(centers, 3), mesh.positions[at], colors, mesh.uv[at]])
    return rows[np.lexsort(rows.T[::-1])]


@pytest.mark.parametrize(("kind", "interpolation"), [(k, i) for k, counts in COUNTS.items() for i in counts])
def test_primvars_of_cubes_and_planes_are_those_of_hydras_mesh(tmp_path, kind, interpolation):
    random = np.random.default_rng(3)
    count = COUNTS[kind][interpolation]
    colors = [tuple(each) for each in random.uniform(size=(count, 3)).round(3).tolist()]
    uv = [tuple(each) for each in random.uniform(size=(count, 2)).round(3).tolist()]
    primvars = f'color3f[] primvars:displayColor = {colors} (interpolation = "{interpolation}")\n'
    primvars += f'texCoord2f[] primvars:st = {uv} (interpolation = "{interpolation}")\n'
    mesh = f'def Mesh "M"\n{{\n uniform token subdivisionScheme = "none"\n{MESHES[kind]}\n{primvars}}}\n'
    description = read(tmp_path, f'def {kind} "G"\n{{\n{primvars}}}\n' + mesh)
    found = corner_values(description, 0)
    # The diagonals of the faces differ: compare corners of a face once each.
    unique = [np.unique(np.round(rows[:, 1:], 5), axis=0) for rows in (found, corner_values(description, 1))]
    np.testing.assert_allclose(*unique, atol=1e-5)


def test_material_of_a_cube_reads_its_primvars(tmp_path):
    material = preview_material(
        "/Look",
        "color3f inputs:diffuseColor.connect = </Look/Reader.outputs:result>",
        shaders='def Shader "Reader"\n{\n uniform token info:id = "UsdPrimvarReader_float3"\n'
        'string inputs:varname = "Cd"\n float3 outputs:result\n}',
    )
    colors = [(row / 8, 0, 1 - row / 8) for row in range(8)]
    body = f"""def Cube "G" (prepend apiSchemas = ["MaterialBindingAPI"])
{{
    color3f[] primvars:Cd = {colors} (interpolation = "vertex")
    rel material:binding = </Look>
}}
"""
    (mesh,) = read(tmp_path, material + body).meshes
    points = np.array(eval(f"[{CUBE_POINTS}]"))
    for position, color in zip(mesh.positions, mesh.colors, strict=True):
        (row,) = np.flatnonzero((points == position).all(axis=1))
        np.testing.assert_allclose(color[:3], colors[row], atol=1e-6)


def test_texture_coordinates_of_round_shapes_are_reported(tmp_path):
    body = 'def Sphere "G"\n{\n texCoord2f[] primvars:st = [(0, 0)] (interpolation = "vertex")\n}\n'
    (mesh,) = read_with_warning(tmp_path, body, "primvars:st of a Sphere is not used.*</G>").meshes
    assert mesh.uv.max() == 1.0


def test_primvar_that_does_not_fit_a_cube_is_reported(tmp_path):
    color = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = "uniform")'
    text = "primvars:displayColor: 2 values, but uniform interpolation needs 6"
    description = read_with_warning(tmp_path, f'def Cube "G"\n{{\n {color}\n}}\n', text)
    assert {description.materials[row].diffuse_color for row in description.meshes[0].materials} == {(0.18,) * 3}


def test_cube_that_grows_keeps_the_colors_of_its_faces(tmp_path):
    colors = [(row / 6, 0, 0) for row in range(6)]
    body = f"""def Cube "G"
{{
    double size.timeSamples = {{ 0: 1, 10: 2 }}
    color3f[] primvars:displayColor = {colors} (interpolation = "uniform")
}}
"""
    description = read(tmp_path, body, more="timeCodesPerSecond = 10")
    (mesh,) = description.meshes
    assert mesh.deformation is not None
    red = [description.materials[row].diffuse_color[0] for row in mesh.materials]
    axes = facing(mesh.positions, mesh.triangles) @ [1, 2, 3]
    order = [3, -3, 2, -2, 1, -1]
    np.testing.assert_allclose(red, [order.index(round(axis)) / 6 for axis in axes], atol=1e-6)
