# SPDX-License-Identifier: Apache-2.0
"""Portals: densities of directions through them, and less noise in a room with a window."""

import math

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
from tests.render.lights.test_lights import BRIGHT, SKY, placed
from tests.render.path_scenes import described, device_scene, matte, quad, render
from tests.render.shading import Illumination
from tiscene.scene.camera import Camera
from tiscene.scene.description import DomeLight, Portal, SceneDescription, Texture

COUNT = 100_000
ORIGIN = (0.3, -0.2, 0.5)
LEFT = Portal(placed((-1.5, 0.4, 0.3), (1.0, 0.0, 0.1)), 1.0, 1.4)
ABOVE = Portal(placed((0.2, 1.6, 0.4), (0.1, -1.0, 0.05)), 1.5, 0.8)
HIGHER = Portal(placed((0.6, 2.4, 0.4), (0.0, -1.0, 0.0)), 1.6, 1.6)  # partly behind ABOVE
FAR = Portal(placed((0.0, 0.2, 30.0), (0.1, 0.0, -1.0)), 0.9, 1.2)
BEHIND = Portal(placed((2.0, 0.0, 0.0), (1.0, 0.2, 0.0)), 2.0, 2.0)  # light enters away from ORIGIN

PLAIN = Texture("plain", np.minimum(SKY[0].pixels, 1.5), encoding="raw")  # without the sun
SETS = {
    "one": (LEFT,),
    "two": (LEFT, ABOVE),
    "overlapping": (ABOVE, HIGHER, LEFT),
    "one behind": (BEHIND, LEFT),
}


def dome(portals: tuple[Portal, ...], image: Texture = PLAIN) -> Illumination:
    matrix = placed((0.0, 0.0, 0.0), (0.4, -0.3, 0.8))
    return Illumination(DomeLight("d", "/d", matrix, BRIGHT, 0, portals), ORIGIN, (image,))


def crossed(portal: Portal, directions: np.ndarray) -> np.ndarray:
    """Return which directions from ORIGIN leave through a portal."""
    matrix = portal.world_from_portal
    offset = matrix[:3, 3] - ORIGIN
    cosine = directions @ matrix[:3, 2]
    with np.errstate(divide="ignore"):
        q = directions * (offset @ matrix[:3, 2] / cosine)[:, None] - offset
    inside = (np.abs(q @ matrix[:3, 0]) < portal.width / 2) & (np.abs(q @ matrix[:3, 1]) < portal.height / 2)
    return inside & (cosine > 0.0) & (offset @ matrix[:3, 2] > 0.0)


def numbers(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).random((COUNT, 2), np.float32)


@pytest.mark.parametrize("image", [PLAIN, SKY[0]], ids=["plain", "sunny"])
@pytest.mark.parametrize("name", SETS)
def test_directions_follow_density(name: str, image: Texture) -> None:
    light = dome(SETS[name], image)
    directions, _, results = light.sample(numbers(1))
    assert (results[:, 0] > 0.0).all()

    def density(coordinates: np.ndarray) -> np.ndarray:
        return light.seen(directions_of(coordinates))[:, 0]

    coordinates = sphere_coordinates(directions.astype(np.float64))
    assert chi_square(coordinates, density, SPHERE_LOW, SPHERE_HIGH, (12, 24), 96) > MIN_P_VALUE


@pytest.mark.parametrize("portals", [*SETS.values(), (FAR,), (FAR, LEFT)])
def test_ray_has_density_and_radiance_of_its_sample(portals: tuple[Portal, ...]) -> None:
    light = dome(portals)
    directions, radiance, results = light.sample(numbers(2)[:20000])
    again = light.seen(directions)
    assert np.isclose(again[:, 0], results[:, 0], rtol=2e-3).mean() > 0.995  # except for rounding at edges
    assert np.isclose(again[:, 2], radiance[:, 1], rtol=1e-4).all()
    through = np.any([crossed(portal, directions) for portal in portals], axis=0)
    assert through.mean() > 0.999


@pytest.mark.parametrize("name", SETS)
def test_density_is_zero_outside_portals_and_integrates_to_one(name: str) -> None:
    portals = SETS[name]
    directions = np.random.default_rng(3).normal(size=(400_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    count = np.sum([crossed(portal, directions) for portal in portals], axis=0)
    density = dome(portals).seen(directions.astype(np.float32))[:, 0]
    assert (density[count == 0] > 0.0).mean() < 1e-3
    assert (density[count > 0] > 0.0).mean() > 0.999
    assert 4.0 * math.pi * density.mean() == pytest.approx(1.0, rel=0.02)
    if name == "one":  # uniform in solid angle
        assert density[count == 1].std() < 0.01 * density[count == 1].mean()


def test_portal_beside_a_point_is_chosen_by_its_solid_angle() -> None:
    """Of the light at a window's reveal, most comes through that window, though it is seen at a grazing angle."""
    x, y, z = ORIGIN
    beside = Portal(placed((x - 0.1, y + 0.9, z), (1.0, 0.0, 0.0)), 1.5, 1.8)
    opposite = Portal(placed((x + 3.0, y, z), (-1.0, 0.0, 0.0)), 1.5, 1.8)
    everywhere = np.random.default_rng(5).normal(size=(COUNT, 3))
    solid_angles = [crossed(portal, everywhere).sum() for portal in (beside, opposite)]
    directions, _, _ = dome((beside, opposite)).sample(numbers(6))
    chosen = [crossed(portal, directions).sum() for portal in (beside, opposite)]
    assert solid_angles[0] > 10.0 * solid_angles[1]
    assert chosen[0] > 5.0 * chosen[1]  # a tenth of the samples is spread evenly


def test_dome_image_is_sampled_where_no_portal_faces() -> None:
    alone, plain = dome((BEHIND,)), dome(())
    for ours, theirs in zip(alone.sample(numbers(4)), plain.sample(numbers(4)), strict=True):
        np.testing.assert_array_equal(ours, theirs)


CAMERA = Camera.look_at((0.9, 0.0, 0.0), (-0.2, -0.3, 0.0), vertical_fov=1.4)


def room(portals: tuple[Portal, ...], image: Texture) -> SceneDescription:
    """Return a white box of 2 m under the sky; its -z wall has a 0.6 x 0.4 m window, its roof a 0.2 m hole."""
    a, b, x, y, r = -1.0, 1.0, 0.3, 0.2, 0.1
    walls = [
        quad((a, a, b), (a, a, a), (a, b, a), (a, b, b)),
        quad((b, a, a), (b, a, b), (b, b, b), (b, b, a)),
        quad((a, a, b), (b, a, b), (b, a, a), (a, a, a)),
        quad((b, a, b), (a, a, b), (a, b, b), (b, b, b)),
        *(quad((p, q, a), (s, q, a), (s, t, a), (p, t, a)) for p, q, s, t in _round(a, b, -x, -y, x, y)),
        *(quad((p, b, q), (s, b, q), (s, b, t), (p, b, t)) for p, q, s, t in _round(a, b, -r, -r, r, r)),
    ]
    light = DomeLight("sky", "/sky", placed((0, 0, 0), (0.4, -0.3, 0.8)), (1.0, 1.0, 1.0), 0, portals)
    return described(walls, [matte("white", (0.6, 0.6, 0.6))], [light], [image])


def _round(a: float, b: float, x0: float, y0: float, x1: float, y1: float) -> tuple[tuple[float, ...], ...]:
    """Return the four rectangles of a square a..b with a hole."""
    return (a, a, x0, b), (x1, a, b, b), (x0, a, x1, y0), (x0, y1, x1, b)


@pytest.mark.parametrize(("image", "gain"), [(PLAIN, 2.5), (SKY[0], 0.8)], ids=["plain", "sunny"])
def test_portals_reduce_noise_without_bias(image: Texture, gain: float) -> None:
    """Only the window has a portal; light through the roof is found by BSDF sampling."""
    matrix = np.diag((-1.0, 1.0, -1.0, 1.0))
    matrix[2, 3] = -1.0
    window = Portal(matrix, 0.6, 0.4)
    runs = {}
    for name, portals in (("with", (window,)), ("without", ())):
        scene = device_scene(room(portals, image))
        runs[name] = np.array([render(scene, CAMERA, spp=64, max_depth=4, seed=seed).hdr for seed in range(16)])
    means = {name: images.mean(axis=(1, 2, 3)) for name, images in runs.items()}
    error = np.hypot(means["with"].std(), means["without"].std()) / 4.0
    assert error < 0.02 * means["without"].mean()
    assert abs(means["with"].mean() - means["without"].mean()) < 3.5 * error
    noise = {name: images.var(axis=0).mean() for name, images in runs.items()}
    assert noise["without"] > gain * noise["with"]
