# SPDX-License-Identifier: Apache-2.0
"""Light and shadow linking: which meshes a light lights, and which cast shadows in it, in all kinds of paths."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.path_scenes import described, matte, quad, render, towards
from tiscene.scene.camera import Camera
from tiscene.scene.description import (
    DistantLight,
    ExtendedLobes,
    Material,
    Mesh,
    RectLight,
    SceneDescription,
    SphereLight,
)

CAMERA = Camera((0.0, 0.0, 5.0), orthographic_height=2.0)  # sees x -2..2, y -1..1 along -z
DOWN = np.eye(4)  # lights emit along -z, as the camera looks
ABOVE = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3.0], [0, 0, 0, 1]])
WHITE = matte("white", (0.8, 0.8, 0.8))
BLACK = matte("black", (0.0, 0.0, 0.0))
METAL = Material("metal", diffuse_color=(0.9, 0.9, 0.9), metallic=1.0, roughness=0.3)
MIRROR = Material("mirror", diffuse_color=(1.0, 1.0, 1.0), metallic=1.0, roughness=0.0)
UNUSED = Material("unused", lobes=ExtendedLobes(sheen_color=(1.0, 1.0, 1.0)))
SUN = DistantLight("sun", "/sun", DOWN, (3.0, 2.0, 1.0))
POINT = SphereLight("point", "/point", ABOVE, (5.0, 5.0, 5.0), 0.0, seen_by_camera=False)
PANEL = RectLight("panel", "/panel", ABOVE, (2.0, 2.0, 2.0), 4.0, 4.0, seen_by_camera=False)
LEFT, RIGHT = (slice(2, -2), slice(1, 14)), (slice(2, -2), slice(18, 31))


def plates(material: int = 0) -> list[Mesh]:
    """Return two plates, of link class 0 on the left and 1 on the right."""
    left = quad((-2, -1, 0), (-0.01, -1, 0), (-0.01, 1, 0), (-2, 1, 0), material=material)
    right = quad((0.01, -1, 0), (2, -1, 0), (2, 1, 0), (0.01, 1, 0), material=material)
    return [left, replace(right, link_class=1)]


def linked(meshes, materials, lights) -> SceneDescription:
    """Return a scene. With links it has an unused extended material, so that it is shaded by the same variant of the
    kernel, which takes 40 s to compile, as the scenes of test_extended_paths.py.
    """
    any_links = any(light.lit or light.shadowing for light in lights)
    return described(meshes, [*materials, UNUSED] if any_links else list(materials), list(lights))


def image(meshes, lights, materials=(WHITE, BLACK, METAL, MIRROR), **others):
    return render(linked(meshes, materials, lights), CAMERA, (32, 16), spp=16, max_depth=2, **others).hdr


@pytest.mark.parametrize("light", [SUN, POINT, PANEL], ids=lambda light: light.name)
@pytest.mark.parametrize("material", [0, pytest.param(2, marks=pytest.mark.slow)], ids=["matte", "glossy"])
def test_light_lights_only_the_meshes_that_are_linked(light, material):
    everywhere = image(plates(material), [light])
    both = image(plates(material), [replace(light, lit=(True, True))])
    np.testing.assert_allclose(both, everywhere, rtol=1e-5, atol=1e-6)
    left = image(plates(material), [replace(light, lit=(True, False))])
    np.testing.assert_allclose(left[LEFT], everywhere[LEFT], rtol=1e-5, atol=1e-6)
    assert everywhere[RIGHT].max() > 0.01
    assert not left[RIGHT].any()


def test_lights_with_different_links_add_up():
    other = replace(SUN, world_from_light=towards((0, 0, 0), (0.5, 0.2, -1.0)))
    linked = [replace(SUN, lit=(True, False)), replace(POINT, lit=(False, True)), replace(other, lit=(True, True))]
    found = image(plates(), linked)
    parts = [image(plates(), [light]) for light in (SUN, POINT, other)]
    assert found[LEFT].mean() == pytest.approx((parts[0] + parts[2])[LEFT].mean(), rel=0.02)
    assert found[RIGHT].mean() == pytest.approx((parts[1] + parts[2])[RIGHT].mean(), rel=0.02)


def test_sampling_of_lights_alone_agrees_with_multiple_importance_sampling():
    lights = [replace(PANEL, lit=(False, True))]
    both, alone = (image(plates(2), lights, mis=mis) for mis in (True, False))
    assert not both[LEFT].any()
    assert both[RIGHT].mean() == pytest.approx(alone[RIGHT].mean(), rel=0.03)


def test_mirrors_that_are_not_linked_do_not_show_a_light():
    found = image(plates(3), [replace(PANEL, lit=(False, True))])
    assert not found[LEFT].any()
    assert found[RIGHT].mean() == pytest.approx(2.0, rel=0.02)


def test_light_reflected_by_another_mesh_reaches_meshes_that_are_not_linked():
    """Links restrict direct light alone: the wall beside the right plate is lit, and lights it."""
    wall = quad((0.05, -1, 0), (0.05, -1, 2), (0.05, 1, 2), (0.05, 1, 0))
    lights = [replace(SUN, lit=(True, False), world_from_light=towards((0, 0, 0), (-1, 0, 0)))]
    scene = linked([*plates(), wall], [WHITE], lights)
    found = render(scene, CAMERA, (32, 16), spp=16, max_depth=3).hdr
    assert found[RIGHT].mean() > 0.01


@pytest.mark.parametrize("light", [SUN, POINT, PANEL], ids=lambda light: light.name)
def test_only_linked_meshes_cast_shadows(light):
    """A black blind above both plates, outside of the light's shadow link, then within."""
    blind = quad((-4, -4, 1), (4, -4, 1), (4, 4, 1), (-4, 4, 1), material=1)
    camera = replace(CAMERA, position=(0.0, 0.0, 0.5))  # below the blind

    def seen(meshes, lights):
        return render(linked(meshes, [WHITE, BLACK], lights), camera, (32, 16), spp=64, max_depth=2).hdr

    free = seen(plates(), [light])
    blocked = seen([*plates(), replace(blind, link_class=1)], [replace(light, shadowing=(True, True))])
    passed = seen([*plates(), replace(blind, link_class=1)], [replace(light, shadowing=(True, False))])
    assert not blocked[LEFT].any()
    tolerance = 0.02 if light is PANEL else 1e-5  # the panel's direct light is sampled otherwise
    for side in (LEFT, RIGHT):
        assert passed[side].mean() == pytest.approx(free[side].mean(), rel=tolerance)


def test_shadow_rays_pass_many_unlinked_meshes():
    blinds = [
        replace(quad((-4, -4, z), (4, -4, z), (4, 4, z), (-4, 4, z), material=1), link_class=1)
        for z in np.linspace(1.0, 2.0, 40)
    ]
    camera = replace(CAMERA, position=(0.0, 0.0, 0.5))
    scene = linked([*plates(), *blinds], [WHITE, BLACK], [replace(SUN, shadowing=(True, False))])
    found = render(scene, camera, (8, 4), spp=1, max_depth=2).hdr
    np.testing.assert_allclose(found[:, :3], np.tile(np.array([3.0, 2.0, 1.0]) * 0.8 / np.pi, (4, 3, 1)), rtol=1e-4)
