# SPDX-License-Identifier: Apache-2.0
"""Every warp against its density."""

import math

import numpy as np
import pytest
import taichi as ti

from tests.reference.chi_square import (
    MIN_P_VALUE,
    SPHERE_HIGH,
    SPHERE_LOW,
    chi_square,
    directions_of,
    sphere_coordinates,
)
from tiscene.device.kernel_types import Floats1, Floats2, vec2, vec3
from tiscene.render.sampling import warp

COUNT = 100_000


@ti.func
def _cosine(u, parameter):
    return warp.cosine_hemisphere(u)


@ti.func
def _cosine_pdf(w, parameter):
    return warp.cosine_hemisphere_pdf(w)


@ti.func
def _sphere(u, parameter):
    return warp.sphere(u)


@ti.func
def _sphere_pdf(w, parameter):
    return warp.sphere_pdf(w)


@ti.func
def _cone(u, parameter):
    return warp.cone(u, parameter)


@ti.func
def _cone_pdf(w, parameter):
    density = 0.0
    if w.z >= 1.0 - parameter:
        density = warp.cone_pdf(w, parameter)
    return density


@ti.func
def _grazing():
    return vec3(0.8, -0.3, 0.35).normalized()


@ti.func
def _visible_normal(u, parameter):
    return warp.visible_normal(u, _grazing(), parameter)


@ti.func
def _visible_normal_pdf(w, parameter):
    density = 0.0
    if w.z > 0.0:
        wo = _grazing()
        density = warp.ggx_masking(wo, parameter) * warp.ggx_density(w, parameter) * ti.max(wo.dot(w), 0.0) / wo.z
    return density


PAIRS = {
    "cosine_hemisphere": (_cosine, _cosine_pdf),
    "sphere": (_sphere, _sphere_pdf),
    "cone": (_cone, _cone_pdf),
    "visible_normal": (_visible_normal, _visible_normal_pdf),
}
FUNCTIONS = tuple(PAIRS.values())


@ti.kernel
def sample_all(pair: ti.template(), numbers: Floats2, parameter: ti.f32, directions: Floats2):
    for i in range(numbers.shape[0]):
        w = FUNCTIONS[pair][0](vec2(numbers[i, 0], numbers[i, 1]), parameter)
        for c in ti.static(range(3)):
            directions[i, c] = w[c]


@ti.kernel
def density_all(pair: ti.template(), directions: Floats2, parameter: ti.f32, density: Floats1):
    for i in range(directions.shape[0]):
        density[i] = FUNCTIONS[pair][1](vec3(directions[i, 0], directions[i, 1], directions[i, 2]), parameter)


def numbers(seed: int, columns: int = 2) -> np.ndarray:
    return np.random.default_rng(seed).random((COUNT, columns), np.float32)


@pytest.mark.parametrize(
    ("name", "parameter"),
    [
        ("cosine_hemisphere", 0.0),
        ("sphere", 0.0),
        ("cone", 0.5),
        ("cone", 1.7),
        ("visible_normal", 0.3),
        ("visible_normal", 0.6),
        ("visible_normal", 1.0),
    ],
)
def test_directions_follow_density(name: str, parameter: float) -> None:
    pair = list(PAIRS).index(name)
    directions = np.empty((COUNT, 3), np.float32)
    sample_all(pair, numbers(1), parameter, directions)
    assert np.abs(np.linalg.norm(directions, axis=1) - 1.0).max() < 1e-5

    def density(coordinates: np.ndarray) -> np.ndarray:
        values = np.empty(len(coordinates), np.float32)
        density_all(pair, directions_of(coordinates).astype(np.float32), parameter, values)
        return values.astype(np.float64)

    cells = (80, 12)  # fine enough for the peak about a normal; the cones' rims lie on edges of cells
    assert chi_square(sphere_coordinates(directions), density, SPHERE_LOW, SPHERE_HIGH, cells) > MIN_P_VALUE


@ti.kernel
def sample_disk(numbers: Floats2, points: Floats2):
    for i in range(numbers.shape[0]):
        p = warp.disk(vec2(numbers[i, 0], numbers[i, 1]))
        points[i, 0], points[i, 1] = p.x, p.y


def test_disk_is_uniform() -> None:
    points = np.empty((COUNT, 2), np.float32)
    sample_disk(numbers(2), points)
    squared = (points.astype(np.float64) ** 2).sum(axis=1)
    assert squared.max() <= 1.0 + 1e-6
    polar = np.stack([0.5 * squared, np.arctan2(points[:, 1], points[:, 0]) % (2 * math.pi)], axis=-1)
    p_value = chi_square(polar, lambda at: np.full(len(at), 1.0 / math.pi), (0.0, 0.0), (0.5, 2.0 * math.pi))
    assert p_value > MIN_P_VALUE


@ti.kernel
def sample_rectangle(
    x0: ti.f32, x1: ti.f32, y0: ti.f32, y1: ti.f32, z: ti.f32, numbers: Floats2, points: Floats2
) -> ti.f32:
    view = warp.rectangle_view(x0, x1, y0, y1, z)
    for i in range(numbers.shape[0]):
        p = warp.rectangle(view, vec2(numbers[i, 0], numbers[i, 1]))
        points[i, 0], points[i, 1] = p.x, p.y
    return 1.0 / warp.rectangle_pdf(view)


RECTANGLES = {
    "below the middle": (-1.0, 1.0, -0.5, 0.5, 0.7),
    "to one side": (0.3, 2.0, 1.0, 1.4, 0.5),
    "almost half the sphere": (-30.0, 20.0, -20.0, 40.0, 0.2),
    "seen edge on": (1.0, 3.0, -1.0, 1.0, 0.02),
    "far away": (-0.5, 0.5, 2.0, 3.0, 12.0),
}


@pytest.mark.parametrize("name", RECTANGLES)
def test_rectangle_is_uniform_in_solid_angle(name: str) -> None:
    x0, x1, y0, y1, z = RECTANGLES[name]
    points = np.empty((COUNT, 2), np.float32)
    solid_angle = sample_rectangle(x0, x1, y0, y1, z, numbers(3), points)

    def corner(x: float, y: float) -> float:
        return math.atan(x * y / (z * math.sqrt(x * x + y * y + z * z)))

    exact = corner(x1, y1) + corner(x0, y0) - corner(x1, y0) - corner(x0, y1)
    assert solid_angle == pytest.approx(exact, rel=1e-3)

    def density(at: np.ndarray) -> np.ndarray:
        squared = at[:, 0] ** 2 + at[:, 1] ** 2 + z * z
        return z / (squared * np.sqrt(squared)) / exact

    fine = 128 if min(x1 - x0, y1 - y0) > 10 * z else 16
    assert chi_square(points.astype(np.float64), density, (x0, y0), (x1, y1), (16, 16), fine) > MIN_P_VALUE


@ti.kernel
def frames(normals: Floats2, errors: Floats1):
    for i in range(normals.shape[0]):
        n = vec3(normals[i, 0], normals[i, 1], normals[i, 2])
        s, t = warp.tangents(n)
        error = ti.abs(s.dot(n)) + ti.abs(t.dot(n)) + ti.abs(s.dot(t)) + (s.cross(t) - n).norm()
        errors[i] = error + ti.abs(s.norm() - 1.0) + ti.abs(t.norm() - 1.0)


def test_tangents_form_right_handed_frames() -> None:
    normals = np.random.default_rng(4).normal(size=(1000, 3))
    normals = np.concatenate([normals, np.eye(3), -np.eye(3), [[1e-8, 0.0, -1.0]]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    errors = np.empty(len(normals), np.float32)
    frames(normals.astype(np.float32), errors)
    assert errors.max() < 2e-6
