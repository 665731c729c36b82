# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import taichi as ti

from tests.render.label_scenes import PlacedMesh, Stage, plate, pose
from tiscene.device.argument_bundles import bundled
from tiscene.device.kernel_types import Floats1, vec3
from tiscene.render.intersect.surface_interaction import (
    Geometry,
    VisibleSurface,
    geometry_of,
    offset_origin,
    surface_at,
)
from tiscene.scene.description import Mesh
from tiscene.scene.placement import CURRENT, NEXT

POSITION, OBJECT_POINT, FLAT, NORMAL, DP_DU, DP_DV, UV = (slice(3 * i, 3 * i + 3) for i in range(7))
FRONT, MAGNITUDE = 20, 21


@ti.kernel
@bundled
def describe(
    geometry: Geometry,
    time: ti.i32,
    b1: ti.f32,
    b2: ti.f32,
    direction: Floats1,
    result: Floats1,
):
    """Write what `surface_at` returns for triangle 0 of instance 0."""
    for _ in range(1):
        s = surface_at(geometry, 0, 0, b1, b2, time, vec3(direction[0], direction[1], direction[2]))
        for c in ti.static(range(3)):
            result[c] = s.position[c]
            result[3 + c] = s.object_point[c]
            result[6 + c] = s.geometric_normal[c]
            result[9 + c] = s.normal[c]
            result[12 + c] = s.dp_du[c]
            result[15 + c] = s.dp_dv[c]
        result[18] = s.uv.x
        result[19] = s.uv.y
        result[20] = ti.cast(s.front, ti.f32)
        result[21] = s.magnitude


@ti.kernel
def offset(point: Floats1, normal: Floats1, magnitude: ti.f32, direction: Floats1, result: Floats1):
    for _ in range(1):
        here = VisibleSurface(
            position=vec3(point[0], point[1], point[2]),
            geometric_normal=vec3(normal[0], normal[1], normal[2]),
            magnitude=magnitude,
        )
        moved = offset_origin(here, vec3(direction[0], direction[1], direction[2]))
        for c in ti.static(range(3)):
            result[c] = moved[c]


def surface(
    stage: Stage, b1: float, b2: float, direction: tuple[float, float, float], time: int = CURRENT
) -> np.ndarray:
    result = np.zeros(22, np.float32)
    describe(*geometry_of(stage.scene), time, b1, b2, np.array(direction, np.float32), result)
    return result


def sheared() -> Stage:
    """Return a triangle with normals and uv, rotated, stretched and mirrored, and moved in the next frame."""
    mesh = Mesh(
        name="triangle",
        positions=np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0]], np.float32),
        triangles=np.array([[0, 1, 2]], np.int32),
        materials=np.zeros(1, np.int32),
        normals=np.array([[0, 0, 1], [0.6, 0, 0.8], [0, 0.6, 0.8]], np.float32),
        uv=np.array([[0.1, 0.2], [0.9, 0.4], [0.2, 1.2]], np.float32),
    )
    now = pose((1, 2, 3), (0.9, 0.1, 0.3, -0.2)) @ np.diag([-1.5, 0.5, 2.0, 1.0])
    return Stage([mesh], [PlacedMesh(0, [now, now, now + np.eye(3, 4, 3)])])


def test_position_uv_and_derivatives_agree_with_numpy() -> None:
    stage, b1, b2 = sheared(), 0.25, 0.5
    found = surface(stage, b1, b2, (0, 0, -1))
    np.testing.assert_allclose(found[OBJECT_POINT], (0.5, 0.5, 0), atol=1e-6)
    matrix = stage.placement.world_from_object[CURRENT, 0]
    np.testing.assert_allclose(found[POSITION], matrix @ (0.5, 0.5, 0, 1), atol=1e-6)
    corners = np.array([[0.1, 0.2], [0.9, 0.4], [0.2, 1.2]])
    np.testing.assert_allclose(found[18:20], (0.25, 0.25, 0.5) @ corners, atol=1e-6)
    for step in ((0.1, 0.0), (0.0, 0.1), (0.05, -0.1)):
        other = surface(stage, b1 + step[0], b2 + step[1], (0, 0, -1))
        du, dv = other[18:20] - found[18:20]
        np.testing.assert_allclose(other[POSITION] - found[POSITION], found[DP_DU] * du + found[DP_DV] * dv, atol=1e-5)


def test_normals_stay_perpendicular_under_stretch_and_face_the_viewer() -> None:
    stage = sheared()
    corners = [surface(stage, *b, (0, 0, -1))[POSITION] for b in ((0, 0), (1, 0), (0, 1))]
    outward = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    outward *= -1 / np.linalg.norm(outward)  # a mirrored triangle is clockwise seen from outside
    front, back = surface(stage, 0.0, 0.0, tuple(-outward)), surface(stage, 0.0, 0.0, tuple(outward))
    np.testing.assert_allclose(front[FLAT], outward, atol=1e-5)
    np.testing.assert_allclose(back[FLAT], -outward, atol=1e-5)
    np.testing.assert_allclose(front[NORMAL], outward, atol=1e-5)  # the normal of the first vertex
    np.testing.assert_allclose(back[NORMAL], -outward, atol=1e-5)
    assert (front[FRONT], back[FRONT]) == (1.0, 0.0)
    inside = surface(stage, 0.4, 0.4, tuple(-outward))
    assert inside[NORMAL] @ inside[FLAT] > 0.0
    assert np.linalg.norm(inside[NORMAL]) == pytest.approx(1.0, abs=1e-6)


def test_time_selects_pose() -> None:
    stage = sheared()
    step = surface(stage, 0.2, 0.2, (0, 0, -1), NEXT) - surface(stage, 0.2, 0.2, (0, 0, -1), CURRENT)
    np.testing.assert_allclose(step[POSITION], (1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(step[OBJECT_POINT], 0.0, atol=1e-6)


def test_mesh_without_uv_has_zero_uv_and_valid_tangents() -> None:
    flat = plate(2.0, 2.0)
    bare = Mesh("bare", flat.positions, flat.triangles, flat.materials)
    found = surface(Stage([bare], [PlacedMesh(0, [pose()])]), 0.3, 0.3, (0, 0, -1))
    np.testing.assert_array_equal(found[18:20], 0.0)
    assert np.linalg.norm(np.cross(found[DP_DU], found[DP_DV])) > 0.1
    np.testing.assert_allclose(found[NORMAL], (0, 0, 1), atol=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_ray_origins_are_offset_to_the_side_of_the_direction(scale: float) -> None:
    point, normal = np.array([0.3, -1.0, 0.2], np.float32) * scale, np.array([0, 0, 1], np.float32)
    for direction, sign in (((0.5, 0, 0.5), 1), ((0.5, 0, -0.5), -1)):
        result = np.zeros(3, np.float32)
        offset(point, normal, float(np.abs(point).max()), np.array(direction, np.float32), result)
        moved = result - point
        assert sign * moved[2] > 4 * np.spacing(np.float32(scale))
        assert abs(moved[2]) < 1e-4 * max(scale, 1.0)
        assert moved[0] == moved[1] == 0.0


def test_magnitude_is_largest_coordinate_or_side() -> None:
    stage = sheared()
    moved = surface(stage, 0.25, 0.25, (0, 0, -1))
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 0]]) @ np.asarray(stage.instances[0].poses[CURRENT])[:3, :3].T
    sides = np.abs(corners[1:] - corners[0]).max()
    assert moved[MAGNITUDE] == pytest.approx(max(sides, np.abs(moved[POSITION]).max()), rel=1e-5)
