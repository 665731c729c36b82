# SPDX-License-Identifier: Apache-2.0
"""Every kind of light: samples against density, samples against rays, irradiance against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.reference.chi_square import (
    MIN_P_VALUE,
    SPHERE_HIGH,
    SPHERE_LOW,
    chi_square,
    directions_of,
    sphere_coordinates,
)
from tests.render.path_scenes import BOX_CAMERA, CORNELL, box, described, matte, quad, render
from tests.render.shading import Illumination
from tiscene.scene.camera import Camera, quaternion_from_matrix
from tiscene.scene.description import (
    CylinderLight,
    DiskLight,
    DistantLight,
    DomeLight,
    Light,
    RectLight,
    Shaping,
    SphereLight,
    Texture,
)
from tiscene.scene.lights.image_distribution import dome_distribution

COUNT = 100_000
ORIGIN = (0.3, -0.2, 0.5)


def placed(position: tuple[float, float, float], towards: tuple[float, float, float]) -> np.ndarray:
    """Return a light's matrix: at a position, its -z along `towards`."""
    z = -np.asarray(towards, float) / np.linalg.norm(towards)
    x = np.cross((0.2, 1.0, 0.1), z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    matrix[:3, 3] = position
    assert quaternion_from_matrix(matrix[:3, :3])
    return matrix


def image(height: int = 24, width: int = 48, seed: int = 3) -> Texture:
    """Return a latlong image with soft structure and a small sun."""
    generator = np.random.default_rng(seed)
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = generator.random((height, width, 1)) * 0.5 + np.linspace(1.0, 0.1, height)[:, None, None]
    pixels[5:7, 30:33, :3] = 40.0
    return Texture("sky", pixels, encoding="raw")


TILT = placed((0.2, 1.5, 0.4), (0.1, -1.0, 0.05))
BRIGHT = (2.0, 3.0, 4.0)
SKY = (image(),)
LIGHTS: dict[str, Light] = {
    "rect": RectLight("l", "/l", TILT, BRIGHT, 1.2, 0.8),
    "textured rect": RectLight("l", "/l", TILT, BRIGHT, 1.2, 0.8, 0),
    "far textured rect": RectLight("l", "/l", placed((3.0, 60.0, 2.0), (0.3, -1.0, 0.2)), BRIGHT, 2.0, 1.0, 0),
    "large rect": RectLight("l", "/l", placed((0.2, 0.1, 0.4), (0.1, -1.0, 0.05)), BRIGHT, 5.0, 8.0),
    "far rect": RectLight("l", "/l", placed((3.0, 60.0, 2.0), (0.3, -1.0, 0.2)), BRIGHT, 2.0, 1.0),
    "disk": DiskLight("l", "/l", TILT, BRIGHT, 0.7),
    "sphere": SphereLight("l", "/l", TILT, BRIGHT, 0.6),
    "small sphere": SphereLight("l", "/l", placed((2.0, 30.0, 1.0), (0, -1, 0)), BRIGHT, 0.02),
    "cylinder": CylinderLight("l", "/l", TILT, BRIGHT, 0.3, 1.5),
    "far cylinder": CylinderLight("l", "/l", placed((2.0, 30.0, 1.0), (0, -1, 0)), BRIGHT, 0.02, 1.2),
    "sun": DistantLight("l", "/l", TILT, BRIGHT, 0.4),
    "dome": DomeLight("l", "/l", np.eye(4), BRIGHT),
    "sky": DomeLight("l", "/l", placed((0, 0, 0), (0.4, -0.3, 0.8)), BRIGHT, 0),
    "point": SphereLight("l", "/l", TILT, BRIGHT, 0.0),
    "parallel": DistantLight("l", "/l", TILT, BRIGHT, 0.0),
}
DELTA = ("point", "parallel")


def seen(name: str, origin: tuple[float, float, float] = ORIGIN) -> Illumination:
    return Illumination(LIGHTS[name], origin, SKY)


def numbers(seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).random((COUNT, 2), np.float32)


def frame_about(axis: np.ndarray) -> np.ndarray:
    """Return axes as rows, the last of them along `axis`."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(z, (0.6, 0.0, 0.8))
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


FAR = ("far rect", "far textured rect", "small sphere", "far cylinder")


@pytest.mark.parametrize("name", [name for name in LIGHTS if name not in (*DELTA, *FAR)])
def test_directions_follow_density(name: str) -> None:
    light = seen(name)
    directions, _, results = light.sample(numbers())
    assert (results[:, 0] > 0.0).mean() > 0.999
    # In a frame about the light's center, so that the light is in few bins of cosine.
    frame = frame_about(directions.astype(np.float64).mean(axis=0))
    local = directions.astype(np.float64) @ frame.T

    def density(coordinates: np.ndarray) -> np.ndarray:
        return light.seen(directions_of(coordinates) @ frame)[:, 0]

    low = (max(local[:, 2].min() - 0.02, -1.0), 0.0) if name not in ("dome", "sky") else SPHERE_LOW
    assert chi_square(sphere_coordinates(local), density, low, SPHERE_HIGH, (12, 24), 48) > MIN_P_VALUE


@pytest.mark.parametrize("name", FAR)
def test_directions_to_small_lights_follow_density(name: str) -> None:
    """Binned in a plane across the light's direction, since float32 cosines near 1 are too coarse."""
    light = seen(name)
    directions, _, results = light.sample(numbers(8))
    assert (results[:, 0] > 0.0).mean() > 0.999
    frame = frame_about(np.asarray(LIGHTS[name].world_from_light[:3, 3]) - ORIGIN)
    local = directions.astype(np.float64) @ frame.T
    points = local[:, :2] / local[:, 2:]

    def density(points: np.ndarray) -> np.ndarray:
        towards = np.concatenate([points, np.ones((len(points), 1))], axis=1)
        length = np.linalg.norm(towards, axis=1)
        return light.seen((towards / length[:, None]) @ frame)[:, 0] / length**3

    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.02 * (high - low)
    assert chi_square(points, density, tuple(low - margin), tuple(high + margin), (12, 12), 48) > MIN_P_VALUE


@pytest.mark.parametrize("name", [name for name in LIGHTS if name not in DELTA])
def test_ray_along_sample_hits_light_with_same_values(name: str) -> None:
    """The ray finds the same distance, density and radiance, except for rounding at edges."""
    light = seen(name)
    directions, radiance, results = light.sample(numbers(2)[:20000])
    rays = light.seen(directions)
    is_hit = rays[:, 0] > 0.0
    assert is_hit.mean() > 0.99
    close = np.isclose(rays[:, 0], results[:, 0], rtol=2e-3)
    assert close[is_hit].mean() > 0.99  # a dome's direction may round into the next cell
    assert np.isclose(rays[:, 2], radiance[:, 1], rtol=1e-3, atol=1e-4)[is_hit].mean() > 0.99
    if np.isfinite(rays[is_hit, 1]).all():
        assert np.median(np.abs(rays[is_hit, 1] / results[is_hit, 1] - 1.0)) < 1e-4


def irradiance(light: Illumination, normal: tuple[float, float, float]) -> np.ndarray:
    directions, radiance, results = light.sample(numbers(4))
    cosine = np.clip(directions @ np.asarray(normal), 0.0, None)
    weight = np.divide(cosine, results[:, 0], out=np.zeros(COUNT), where=results[:, 0] > 0.0)
    return (radiance * weight[:, None]).mean(axis=0)


def overhead(kind: type[Light], **sizes: object) -> Illumination:
    matrix = np.eye(4)
    matrix[2, 3] = 2.0
    return Illumination(kind("l", "/l", matrix, BRIGHT, **sizes), (0.0, 0.0, 0.0))


UP = (0.0, 0.0, 1.0)


def test_irradiance_below_a_disk() -> None:
    expected = math.pi * 0.5**2 / (0.5**2 + 2.0**2)
    assert irradiance(overhead(DiskLight, radius=0.5), UP) / BRIGHT == pytest.approx(expected, rel=5e-3)


def test_irradiance_below_a_sphere() -> None:
    expected = math.pi * (0.5 / 2.0) ** 2
    assert irradiance(overhead(SphereLight, radius=0.5), UP) / BRIGHT == pytest.approx(expected, rel=5e-3)


def test_irradiance_beside_a_long_cylinder() -> None:
    tube = overhead(CylinderLight, radius=0.1, length=400.0)
    expected = math.pi * 0.1 / 2.0  # view factor of an infinite cylinder
    assert irradiance(tube, UP) / BRIGHT == pytest.approx(expected, rel=0.03)


def test_cylinder_emits_outwards_and_has_no_caps() -> None:
    tube = CylinderLight("l", "/l", np.eye(4), BRIGHT, 0.5, 2.0)
    around = np.random.default_rng(3).normal(size=(200, 3))
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    inside = Illumination(tube, (0.2, 0.1, -0.1))
    assert np.isinf(inside.seen(around)[:, 1]).all()
    assert not inside.sample(numbers()[:100])[2][:, 0].any()
    beyond = Illumination(tube, (3.0, 0.2, 0.0))
    assert np.isinf(beyond.seen([[-1.0, 0.0, 0.0]])[0, 1])


def test_irradiance_below_a_rectangle() -> None:
    a, b = 0.6 / 2.0, 0.4 / 2.0  # half sizes over the height
    quarter = a / math.sqrt(1 + a * a) * math.atan(b / math.sqrt(1 + a * a))
    quarter += b / math.sqrt(1 + b * b) * math.atan(a / math.sqrt(1 + b * b))
    expected = 4.0 * quarter / 2.0
    assert irradiance(overhead(RectLight, width=1.2, height=0.8), UP) / BRIGHT == pytest.approx(expected, rel=5e-3)


def test_irradiance_of_a_point_is_intensity_over_squared_distance() -> None:
    assert irradiance(overhead(SphereLight, radius=0.0), UP) / BRIGHT == pytest.approx(0.25, rel=1e-5)


@pytest.mark.parametrize("angle", [0.0, 0.01, 0.5])
def test_irradiance_of_distant_light_is_independent_of_its_angle(angle: float) -> None:
    sun = Illumination(DistantLight("l", "/l", np.eye(4), BRIGHT, angle), (5.0, 6.0, 7.0))
    assert irradiance(sun, UP) / BRIGHT == pytest.approx(1.0, rel=5e-3)


def test_irradiance_of_a_constant_dome() -> None:
    dome = Illumination(LIGHTS["dome"], ORIGIN)
    assert irradiance(dome, UP) / BRIGHT == pytest.approx(math.pi, rel=1e-2)


def test_irradiance_of_dome_equals_integral_of_its_image() -> None:
    """By the convention of DomeLight's docstring: +y is up, the top of the image."""
    pixels = SKY[0].pixels
    height, width = pixels.shape[:2]
    # The integral of bilinear lookups, on a fine grid of u, v.
    u, v = np.meshgrid((np.arange(960) + 0.5) / 960, (np.arange(480) + 0.5) / 480)
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - left, y - top
    value = 0.0
    for dx, dy, weight in ((0, 0, (1 - fx) * (1 - fy)), (1, 0, fx * (1 - fy)), (0, 1, (1 - fx) * fy), (1, 1, fx * fy)):
        value = value + weight * pixels[np.clip(top + dy, 0, height - 1), (left + dx) % width, 0]
    theta, phi = math.pi * (1.0 - v), 2.0 * math.pi * u - 0.5 * math.pi
    direction = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)], axis=-1)
    for normal in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)):
        cosine = np.clip(direction @ np.array(normal), 0.0, None)
        expected = (value * cosine * np.sin(theta)).mean() * 2.0 * math.pi**2
        sky = Illumination(DomeLight("l", "/l", np.eye(4), (1.0, 1.0, 1.0), 0), ORIGIN, SKY)
        assert irradiance(sky, normal)[0] == pytest.approx(expected, rel=0.02), normal


@pytest.mark.parametrize("radius", [0.0, 0.4])
def test_indirect_multiplier_scales_light_after_first_bounce(radius: float) -> None:
    meshes, materials = box(CORNELL)
    power = 4.0 if radius == 0.0 else 6.0

    def lit(indirect: float, max_depth: int = 5) -> np.ndarray:
        light = SphereLight("l", "/l", placed((0.2, 0.4, 0.3), (0, -1, 0)), (power,) * 3, radius, indirect=indirect)
        description = described(meshes, materials, [light])
        return render(description, BOX_CAMERA, spp=16, max_depth=max_depth).hdr.astype(np.float64)

    direct, full = lit(0.0), lit(1.0)
    assert direct.mean() < 0.95 * full.mean()
    np.testing.assert_allclose(direct, lit(1.0, max_depth=2), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(lit(3.0), direct + 3.0 * (full - direct), rtol=1e-3, atol=1e-4)


def test_dome_image_is_sampled_in_proportion_to_radiance() -> None:
    """The density is proportional to radiance except for interpolation: sample weights hardly vary."""
    light = seen("sky")
    _, radiance, results = light.sample(numbers(6))
    weight = radiance[:, 1] / results[:, 0]
    assert weight.std() < 0.5 * weight.mean()


def test_dome_distribution_is_monotonic_from_zero_to_one() -> None:
    for height, width in ((1, 1), (2, 4), (24, 48), (700, 1500)):
        values, (columns, rows) = dome_distribution(
            image(max(height, 1), width) if height > 6 else _plain(height, width)
        )
        assert (columns, rows) == (min(width, 1024), min(height, 512))
        marginal, conditional = values[: rows + 1], values[rows + 1 :].reshape(rows, columns + 1)
        for cumulative in (marginal, *conditional):
            assert cumulative[0] == 0.0
            assert cumulative[-1] == pytest.approx(1.0)
            assert (np.diff(cumulative) >= 0.0).all()


def test_black_dome_image_gives_finite_samples() -> None:
    black = Texture("black", np.zeros((4, 8, 4), np.float32), encoding="raw")
    light = Illumination(DomeLight("l", "/l", np.eye(4), BRIGHT, 0), ORIGIN, (black,))
    directions, radiance, results = light.sample(numbers()[:1000])
    assert np.isfinite(directions).all()
    assert np.isfinite(results[:, [0, 3]]).all()
    assert not radiance.any()


def _plain(height: int, width: int) -> Texture:
    return Texture("plain", np.full((height, width, 4), 200, np.uint8))


@pytest.mark.parametrize("name", ["rect", "disk"])
def test_flat_lights_emit_from_one_side(name: str) -> None:
    behind = seen(name, (0.2, 3.0, 0.4))
    _, _, results = behind.sample(numbers()[:100])
    assert not results[:, 0].any()
    down = np.tile([[0.0, -1.0, 0.0]], (10, 1))
    assert np.isinf(behind.seen(down)[:, 1]).all()


def test_rect_texture_is_upright_from_the_emitting_side() -> None:
    pixels = np.zeros((2, 2, 4), np.float32)
    pixels[0, 0, :3] = 1.0  # top left
    light = RectLight("l", "/l", np.eye(4), (1.0, 1.0, 1.0), 2.0, 2.0, 0)
    screen = Illumination(light, (0.0, 0.0, -1.0), (Texture("t", pixels, encoding="raw"),))
    corners = np.array([[x, y, 1.0] for y in (0.9, -0.9) for x in (0.9, -0.9)])  # from -z, +x is to the left
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    assert screen.seen(corners)[:, 2] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)


def shaped(shaping: Shaping, kind: type[Light], towards: list[float], **sizes: object) -> float:
    """Return the fraction of its radiance that a light at the origin emits in a direction."""
    matrix = np.eye(4)
    direction = np.asarray(towards, float) / np.linalg.norm(towards)
    light = kind("l", "/l", matrix, (1.0, 1.0, 1.0), shaping=shaping, **sizes)
    seen_from = Illumination(light, tuple(2.0 * direction), (PROFILE,))
    return float(seen_from.seen([-direction])[0, 2])


PROFILE = Texture(
    "profile",
    np.repeat(np.repeat(np.linspace(1.0, 0.0, 180, dtype=np.float32)[:, None, None], 8, 1), 4, 2),
    encoding="raw",
    wrap_t="clamp",
)


def at(degrees: float) -> list[float]:
    """Return a direction at an angle from -z."""
    return [math.sin(math.radians(degrees)), 0.0, -math.cos(math.radians(degrees))]


def test_cone_limits_emission() -> None:
    cone = Shaping(cone_angle=math.radians(30.0))
    assert shaped(cone, SphereLight, at(29.0), radius=0.5) == 1.0
    assert shaped(cone, SphereLight, at(31.0), radius=0.5) == 0.0
    assert shaped(cone, SphereLight, at(180.0), radius=0.5) == 0.0
    everywhere = Shaping(cone_angle=math.pi)
    assert shaped(everywhere, SphereLight, at(180.0), radius=0.5) == 1.0


def test_soft_cone_edge_is_a_smoothstep() -> None:
    cone = Shaping(cone_angle=math.radians(40.0), cone_softness=0.5)
    assert shaped(cone, SphereLight, at(19.9), radius=0.5) == 1.0
    assert shaped(cone, SphereLight, at(25.0), radius=0.5) == pytest.approx(1.0 - 0.25**2 * 2.5, abs=2e-3)
    assert shaped(cone, SphereLight, at(30.0), radius=0.5) == pytest.approx(0.5, abs=2e-3)


def test_focus_is_a_power_of_the_cosine_at_the_surface() -> None:
    focus = Shaping(focus=3.0, focus_tint=(0.0, 0.25, 0.0))
    expected = 0.25 + 0.75 * math.cos(math.radians(50.0)) ** 3
    assert shaped(focus, DiskLight, at(50.0), radius=5.0) == pytest.approx(expected, rel=1e-3)
    assert shaped(focus, SphereLight, at(50.0), radius=0.5) == pytest.approx(
        1.0, rel=1e-3
    )  # perpendicular to the surface


@pytest.mark.parametrize("angle", [10.0, 80.0, 150.0])
def test_ies_profile_scales_by_angle_from_axis(angle: float) -> None:
    seen_there = shaped(Shaping(profile=0), SphereLight, at(angle), radius=0.5)
    assert seen_there == pytest.approx(1.0 - angle / 180.0, abs=6e-3)


def test_samples_of_shaped_light_equal_rays() -> None:
    shaping = Shaping(math.radians(50.0), 0.4, 2.0, (0.1, 0.2, 0.3), 0)
    for light in (
        RectLight("l", "/l", TILT, BRIGHT, 1.2, 0.8, shaping=shaping),
        CylinderLight("l", "/l", TILT, BRIGHT, 0.3, 1.5, shaping=shaping),
    ):
        seen_there = Illumination(light, ORIGIN, (PROFILE,))
        directions, radiance, results = seen_there.sample(numbers(2)[:20000])
        rays = seen_there.seen(directions)
        is_hit = np.isfinite(rays[:, 1]) & (results[:, 0] > 0.0)
        assert is_hit.mean() > 0.9
        assert radiance[is_hit, 1].std() > 0.05
        assert np.isclose(rays[is_hit, 2], radiance[is_hit, 1], rtol=5e-3, atol=1e-3).mean() > 0.99


def test_wide_light_with_a_cone_and_no_shadows_shines_beside_another_light() -> None:
    """The cone of a point of the light reaches beyond that of its center, where no BSDF sample finds the light."""
    floor = quad((-3.0, 0.0, 3.0), (3.0, 0.0, 3.0), (3.0, 0.0, -3.0), (-3.0, 0.0, -3.0))
    camera = Camera.look_at((0.0, 3.0, 0.01), (0.0, 0.0, 0.0), vertical_fov=1.5)
    spot = RectLight("l", "/l", placed((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)), BRIGHT, 2.0, 2.0, shaping=Shaping(0.5, 0.2))
    spot = replace(spot, casts_shadows=False, seen_by_camera=False)
    other = SphereLight("s", "/s", placed((8.0, 5.0, 0.0), (0.0, -1.0, 0.0)), BRIGHT, 0.1)

    def mean(*lights: Light) -> float:
        scene = described([floor], [matte("floor", (0.5, 0.5, 0.5))], list(lights))
        return float(render(scene, camera, spp=256, max_depth=2).hdr.mean())

    assert mean(spot, other) == pytest.approx(mean(spot) + mean(other), rel=0.01)
