# SPDX-License-Identifier: Apache-2.0
"""Parametric gprims: sizes, axes, winding, normals, uv."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.usd.helpers import area, facing, problems_of, read, read_with_warning, volume

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
