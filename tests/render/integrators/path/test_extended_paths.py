# SPDX-License-Identifier: Apache-2.0
"""Paths through surfaces with extended lobes: absorption, panes and anisotropy in whole pictures, in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from tests.render.path_scenes import described, quad, render, towards
from tiscene.scene.camera import Camera
from tiscene.scene.description import DomeLight, ExtendedLobes, Instance, Material, Mesh, RectLight, SceneDescription

WHITE = (1.0, 1.0, 1.0)
# Linked to all meshes, so that test_light_linking.py needs the same variant of the shading kernel: 40 s to compile.
DOME = DomeLight("dome", "/dome", np.eye(4), WHITE, lit=(True,))
GLASS = Material("glass", WHITE, roughness=0.0, ior=1.5, opacity=0.0, opacity_mode="transmission")
# Narrow, to look along the axis.
CAMERA = Camera.look_at((0.0, 0.0, 9.0), (0.0, 0.0, 0.0), vertical_fov=np.radians(0.5))


def slab(thickness: float, material: int = 0) -> Mesh:
    """Return a closed box of a thickness along z, too wide for light to leave through its sides."""
    half, z = 40.0, 0.5 * thickness
    corners = [(x, y, w) for w in (-z, z) for y in (-half, half) for x in (-half, half)]
    faces = [(4, 5, 7, 6), (1, 0, 2, 3), (0, 4, 6, 2), (5, 1, 3, 7), (6, 7, 3, 2), (0, 1, 5, 4)]
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return Mesh("slab", np.array(corners, np.float32), np.array(triangles, np.int32), np.full(12, material, np.int32))


def brightness(scene: SceneDescription, depth: int = 24, spp: int = 256) -> np.ndarray:
    """Return the mean color of a small picture along -z."""
    mean: np.ndarray = render(scene, CAMERA, (4, 4), spp=spp, max_depth=depth).hdr.mean(axis=(0, 1))
    return mean


def test_slab_absorbs_by_beer_and_lambert() -> None:
    """A smooth slab before white: r + t of the geometric series of its two sides, with R = 0.04."""
    thickness, absorption = 0.3, np.array([0.0, 2.0, 7.0])
    glass = replace(GLASS, lobes=ExtendedLobes(absorption=tuple(absorption.tolist())))
    pass_once, r = np.exp(-absorption * thickness), 0.04
    series = 1.0 - (r * pass_once) ** 2
    expected = r + (1 - r) ** 2 * r * pass_once**2 / series + (1 - r) ** 2 * pass_once / series
    np.testing.assert_allclose(brightness(described([slab(thickness)], [glass], [DOME])), expected, atol=6e-3)


def test_scaled_slab_absorbs_by_its_size_in_the_world() -> None:
    glass = replace(GLASS, lobes=ExtendedLobes(absorption=(0.0, 2.0, 7.0)))
    scene = described([slab(0.3)], [glass], [DOME])
    scaled = replace(scene, instances=(Instance(0, 0, np.diag([1.0, 1.0, 2.0, 1.0])),))
    assert brightness(scaled)[1] == pytest.approx(brightness(described([slab(0.6)], [glass], [DOME]))[1], abs=6e-3)


def test_colored_boundaries_color_each_crossing() -> None:
    """Without absorption, the color applies once where light enters and once where it leaves."""
    glass = replace(GLASS, lobes=ExtendedLobes(transmission_color=(1.0, 0.5, 0.0)))
    color, r = np.array([1.0, 0.5, 0.0]), 0.04
    expected = r + ((1 - r) * color) ** 2 * (1.0 + r) / (1 - r * r)
    np.testing.assert_allclose(brightness(described([slab(0.3)], [glass], [DOME])), expected, atol=6e-3)


def test_pane_transmits_once_and_without_shift() -> None:
    """A single sheet: 2 F / (1 + F) is white, the rest is colored once."""
    pane = replace(GLASS, lobes=ExtendedLobes(transmission_color=(1.0, 0.5, 0.0), thin_walled=True))
    sheet = quad((-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (9.0, 9.0, 0.0), (-9.0, 9.0, 0.0))
    reflected = 0.08 / 1.04
    expected = reflected + (1.0 - reflected) * np.array([1.0, 0.5, 0.0])
    np.testing.assert_allclose(brightness(described([sheet], [pane], [DOME]), 3), expected, atol=6e-3)


def test_translucent_sheet_shows_the_light_behind_it() -> None:
    """A sheet lit from behind alone; the specular layer is switched off by its weight."""
    lobes = ExtendedLobes(translucency=0.5, translucent_color=(0.8, 0.4, 0.2), specular=0.0)
    paper = Material("paper", WHITE, roughness=1.0, lobes=lobes)
    front = quad((-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (9.0, 9.0, 0.0), (-9.0, 9.0, 0.0))
    light = RectLight("light", "/light", towards((0.0, 0.0, -0.5), (0.0, 0.0, 1.0)), WHITE, 80.0, 80.0, lit=(True,))
    found = brightness(described([front], [paper], [light]), 3, 1024)
    np.testing.assert_allclose(found, np.array([0.4, 0.2, 0.1]), rtol=0.03)


def test_plain_material_looks_the_same_beside_an_extended_one() -> None:
    """The same bytes of a picture in which the extended material is not visible."""
    floor = quad((-9.0, -9.0, 0.0), (9.0, -9.0, 0.0), (9.0, 9.0, 0.0), (-9.0, 9.0, 0.0))
    metal = Material("metal", (0.8, 0.5, 0.3), metallic=0.5, roughness=0.3, clearcoat=0.5)
    behind = quad((-1.0, -1.0, -5.0), (1.0, -1.0, -5.0), (1.0, 1.0, -5.0), (-1.0, 1.0, -5.0), material=1)
    scene = described([floor, behind], [metal, metal], [replace(DOME, lit=None)])
    plain, extended = (
        render(each, CAMERA, (4, 4), max_depth=3).hdr.tobytes()
        for each in (
            scene,
            replace(scene, materials=(metal, replace(metal, lobes=ExtendedLobes(sheen_color=WHITE))), lights=(DOME,)),
        )
    )
    assert plain == extended
