# SPDX-License-Identifier: Apache-2.0
"""A Cornell box with two moving balls, for tests of incremental rendering, and comparisons of noisy images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.room import static_placement
from tests.render.path_scenes import BOX_CAMERA, CORNELL, WHITE, ball, box, described, matte, quad, towards
from tiscene.render.integrators.incremental.base_image import base_placement
from tiscene.render.integrators.incremental.base_lights import BaseLights
from tiscene.render.integrators.incremental.incremental_pass import (
    CACHED_PATHS_FRAME,
    IncrementalImage,
    IncrementalPass,
)
from tiscene.render.integrators.incremental.path_recording import AUXILIARY, light_column
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.description import DistantLight, DomeLight, Light, Material, RectLight, SphereLight
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_groups import LightGroups, emission_of, with_emission
from tiscene.scene.placement import Placement

SIZE = (32, 24)
LAMP = RectLight("lamp", "/lamp", towards((0.0, 0.99, 0.0), (0.0, -1.0, 0.0)), (18.0, 15.0, 8.0), 0.6, 0.5)
LIGHTS: dict[str, list[Light]] = {
    "lamp": [LAMP],
    "sky and bulb": [
        DomeLight("sky", "/sky", np.eye(4), (0.5, 0.6, 0.9)),
        SphereLight("bulb", "/bulb", towards((0.5, 0.6, 0.2), (0.0, -1.0, 0.0)), (30.0, 20.0, 10.0), 0.1),
        DistantLight("sun", "/sun", towards((0.0, 0.0, 0.0), (0.2, -0.4, -1.0)), (2.0, 2.0, 2.0), 0.01),
    ],
    "shadowless": [
        replace(LAMP, casts_shadows=False),
        SphereLight("l", "/l", towards((0.5, 0.6, 0.2), (0.0, -1.0, 0.0)), (3.0, 3.0, 3.0), 0.1),
    ],
    "indirect multipliers": [
        replace(LAMP, indirect=0.3),
        SphereLight("l", "/l", towards((0.5, 0.6, 0.2), (0.0, -1.0, 0.0)), (3.0, 3.0, 3.0), 0.1, indirect=2.5),
    ],
    "point": [SphereLight("l", "/l", towards((0.0, 0.9, 0.3), (0.0, -1.0, 0.0)), (3.0, 3.0, 3.0), 0.0)],
}
RED, BLUE = matte("red", (0.6, 0.1, 0.1)), matte("blue", (0.1, 0.1, 0.6))
MIRROR = Material("mirror", diffuse_color=WHITE, metallic=1.0, roughness=0.0)
GLASS = Material("glass", diffuse_color=WHITE, opacity=0.0, roughness=0.0)
GLOSSY = Material("glossy", diffuse_color=(0.3, 0.5, 0.3), roughness=0.2, clearcoat=0.5)
EMISSIVE = matte("emissive", (0.2, 0.2, 0.2), emissive_color=(4.0, 3.0, 1.0))
LACE = matte("lace", (0.7, 0.7, 0.2), opacity=0.4, opacity_mode="presence")
MOVERS = {"matte": RED, "mirror": MIRROR, "glass": GLASS, "glossy": GLOSSY, "emissive": EMISSIVE}
BALLS = ((0.3, -0.1, 0.5), (-0.5, 0.3, 0.2))  # default positions
RADII = (0.2, 0.15)
LENS = replace(BOX_CAMERA, lens_radius=0.1, focus_distance=3.0)
QUALITY = {"spp": 4, "max_depth": 5}

Position = tuple[float, float, float]


class MovingBalls:
    """A Cornell box with two balls that move.

    Args:
        mover: Material of the larger ball.
        wall: Material of an additional static wall; None: no such wall.
        lights: A key of LIGHTS.
        camera: The camera.
    """

    def __init__(
        self, mover: Material = RED, wall: Material | None = None, lights: str = "lamp", camera: Camera = BOX_CAMERA
    ) -> None:
        meshes, materials = box(CORNELL)
        if wall is not None:
            meshes.append(quad((-0.9, -0.9, 0.6), (-0.2, -0.9, 0.6), (-0.2, 0.6, 0.3), (-0.9, 0.6, 0.3), material=5))
        static_count = len(meshes)
        for radius, material, subdivisions in zip(RADII, (3, 4), (3, 1), strict=True):
            meshes.append(ball((0, 0, 0), radius, material=material, subdivisions=subdivisions))
        self.lights = LIGHTS[lights]
        scene = described(meshes, [*materials, mover, BLUE, wall or BLUE], self.lights)
        self.device = DeviceScene()
        self.device.add(scene)
        self.placed = static_placement(scene)
        self.moving = np.arange(len(meshes)) >= static_count
        self.groups: LightGroups | None = None
        self.view = View(camera, camera, camera, *SIZE)
        self.incremental = IncrementalPass(PathPass(self.device, *SIZE))

    def at(self, *positions: Position) -> Placement:
        """Return a placement of the balls; a ball without a position is absent."""
        matrices, present = self.placed.world_from_object.copy(), self.placed.present.copy()
        for number, row in enumerate(np.flatnonzero(self.moving)):
            present[:, row] = number < len(positions)
            if number < len(positions):
                matrices[:, row, :, 3] = positions[number]
        groups, lights = self.groups, None
        if groups is not None:
            lights = tuple(
                (row, with_emission(light, tuple(groups.factors[number] * emission_of(light))))  # type: ignore[arg-type]
                for (row, light), number in zip(groups.lights, groups.group, strict=True)
            )
        return replace(self.placed, world_from_object=matrices, present=present, lights=lights, light_groups=groups)

    def dim(self, *factors: tuple[float, float, float]) -> None:
        """Scale the first lights, each in a group of its own; the others keep their intensity."""
        lights = tuple((0, light) for light in self.lights)
        group = tuple(number + 1 if number < len(factors) else 0 for number in range(len(lights)))
        self.groups = LightGroups(lights, group, np.array([(1.0, 1.0, 1.0), *factors], np.float32))

    def render(self, *positions: Position, base_spp: int = 16, seed: int = 1, near_spp: int = 0) -> IncrementalImage:
        """Render incrementally."""
        numbers = {"seed": seed, "base_spp": base_spp, "near_spp": near_spp, **QUALITY}
        self.incremental.prepare(self.view, self.at(*positions), self.moving, **numbers)
        self.device.place(self.at(*positions))
        return self.incremental.render(self.moving)

    def trace(self, *positions: Position, frame: int = CACHED_PATHS_FRAME, spp: int = 4) -> PathImage:
        """Path trace from scratch with the light sampling of incremental rendering.

        Emissive movers are hit but not sampled, and lights are selected as at their maximum intensity.
        """
        placement, paths = self.at(*positions), PathPass(self.device, *SIZE)
        self.device.place(base_placement(placement, self.moving))
        lights = BaseLights(self.device, self.groups)
        self.device.place(placement)
        scene = paths.scene_arrays(lights.scaled(placement.light_factors))
        return paths.render(self.view, frame_index=frame, seed=1, spp=spp, max_depth=QUALITY["max_depth"], scene=scene)


def corrected_path_mean(incremental: IncrementalPass) -> PathImage:
    """Return the frame rendered last as its cached paths show it: their mean plus the correction, without the base.

    It equals path tracing with the random numbers of the cached paths.
    """
    base, scratch = incremental._prepared()
    mean = base.mean.to_numpy()
    for group, factor in enumerate(incremental.scene.placement.light_factors[1:], 1):
        mean[:, :3] += factor * mean[:, light_column(group) : light_column(group) + 3]
    total = mean[:, : light_column(1)] + scratch.correction.to_numpy()[:, : light_column(1)]
    image = total.reshape(incremental.height, incremental.width, light_column(1))
    return PathImage(image[..., :3], image[..., AUXILIARY : AUXILIARY + 3], image[..., AUXILIARY + 3 :])


def stacked(image: PathImage) -> NDArray[np.float32]:
    """Return radiance, albedo and normal as one array [h, w, 9]."""
    return np.concatenate([image.hdr, image.albedo, image.normal], axis=-1)


def check_equal_means(a: NDArray[np.float32], b: NDArray[np.float32], tile: int = 8) -> None:
    """Assert by Welch's test that the means over images [n, h, w, 3] agree, in the whole image and in tiles."""
    for size in (a.shape[1:3], (tile, tile)):
        means = []
        for images in (a, b):
            n, height, width, _ = images.shape
            parts = images.mean(axis=-1).reshape(n, height // size[0], size[0], width // size[1], size[1])
            means.append(parts.mean(axis=(2, 4)).reshape(n, -1).astype(np.float64))
        spread = sum(each.var(axis=0, ddof=1) / len(each) for each in means)
        rounding = 1e-5 * np.abs(means[0]).mean(axis=0)  # a background has no other error
        z = (means[0].mean(axis=0) - means[1].mean(axis=0)) / np.sqrt(spread + rounding**2)
        # Student's t with about 14 degrees of freedom exceeds 5 once in 5,000 times, and there are 12 tiles.
        assert np.abs(z).max() < 5.0, z
        assert np.sqrt((z**2).mean()) < 2.5, z
