# SPDX-License-Identifier: Apache-2.0
"""What all frames of a replay are differences to: one picture of what never moves, in parts by what lights it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache
from tiscene.render.integrators.incremental.base_lights import BaseLights
from tiscene.render.integrators.incremental.mover_coverage import MoverCoverage
from tiscene.render.integrators.incremental.path_cache import PathCache
from tiscene.render.integrators.incremental.path_recording import AUXILIARY, light_column
from tiscene.render.integrators.path.path_pass import PathPass, PathScene
from tiscene.render.view import View
from tiscene.scene.placement import CURRENT, Placement

BASE_FRAME = -1  # what stands for the frame in the keys of random numbers
ROUGHNESS = 0.5  # how much of the kept paths' own picture is in the base that the denoiser is shown

FloatImage = NDArray[np.float32]
ProgressCallback = Callable[[str, float], None]  # what is being made, and how much of it is done, 0..1


@dataclass(frozen=True, eq=False)
class IncrementalBase:
    """What never moves. image: f32 [h, w, 6 + 3 * groups], columns as `light_column` says.

    lights: of it, which alone are sampled: what a mover emits is met.

    looks: what tells how much of each pixel movers cover. near: more paths for pixels in which a mover is seen.

    kept: what others have made of it, by name, for as long as there is use for it.
    """

    lights: BaseLights
    image: FloatImage
    cache: PathCache
    looks: MoverCoverage
    near: PathCache | None = None
    derived: dict[str, FloatImage] = field(default_factory=dict)

    @cached_property
    def mean(self) -> Any:
        """What all kept paths show together, as of `PathCache`."""
        if self.near is None:
            return self.cache.mean
        few, more = self.cache.numbers[0], self.near.numbers[0]
        total = few * self.cache.mean.to_numpy() + more * self.near.mean.to_numpy()
        return upload(total / np.float32(few + more))

    @property
    def spp(self) -> int:
        """How many kept paths go through a pixel in which a mover is seen."""
        return self.cache.numbers[0] + (self.near.numbers[0] if self.near else 0)

    @property
    def bytes(self) -> int:
        """What the kept paths take of memory."""
        return self.cache.bytes + (self.near.bytes if self.near else 0)

    @cached_property
    def rough(self) -> FloatImage:
        """The light of `image` with some of the kept paths' noise, f32 [h, w, 3 * groups].

        A denoiser that is shown little noise around what moves takes the noise of that for detail.
        """
        columns = [light_column(group) + c for group in range(self.lights.groups) for c in range(3)]
        fine = self.image[..., columns]
        rough: FloatImage = fine + ROUGHNESS * (self.mean.to_numpy()[:, columns].reshape(fine.shape) - fine)
        return np.ascontiguousarray(rough)

    def channels(self, group: int = 0) -> tuple[FloatImage, FloatImage, FloatImage]:
        """Radiance under a group of lights, albedo and normal as arrays of their own."""
        radiance, albedo, normal = (
            self.image[..., first : first + 3].copy() for first in (light_column(group), AUXILIARY, AUXILIARY + 3)
        )
        return radiance, albedo, normal

    def noise_matched_channels(self, group: int = 0) -> tuple[FloatImage, FloatImage, FloatImage]:
        """The same, with the radiance of `rough`."""
        _, albedo, normal = self.channels(group)
        return self.rough[..., 3 * group : 3 * group + 3].copy(), albedo, normal


def standing(placement: Placement, moving: NDArray[np.bool_]) -> Placement:
    """What a base is made of: nothing that moves, and all lights at their brightest."""
    groups = placement.light_groups
    lights = placement.lights if groups is None else groups.lights
    return replace(placement, present=placement.present & ~moving, lights=lights)


def under_group(paths: PathPass, group: int, lights: BaseLights | None) -> PathScene:
    """The scene where one group of lights shines; what glows by itself does so in group 0.

    lights: all of them; None: no others are placed.
    """
    if group == 0:
        return paths.scene_arrays(lights.alone(0) if lights else None)
    if lights is None:
        paths.scene.lights.place_meshes([], np.zeros((0, 3, 4)))
    return replace(paths.scene_arrays(lights.alone(group) if lights else None), any_emission=False)


def base_image(
    paths: PathPass,
    images: BaseImageCache | None,
    progress: ProgressCallback,
    view: View,
    standing: Placement,
    *,
    seed: int,
    spp: int,
    max_depth: int,
) -> FloatImage:
    """A picture of the scene under each group of lights. A lamp that is seen has the albedo of its own picture.

    Places what it needs. images: where each group's is kept between runs.
    """
    groups = standing.light_groups
    count = 1 if groups is None else len(groups.factors)
    base = np.empty((paths.height, paths.width, light_column(count)), np.float32)
    for group in range(count):
        paths.scene.place(standing if groups is None else replace(standing, lights=groups.alone(group)))
        scene = under_group(paths, group, None)
        settings: dict[str, int | str] = {
            "seed": seed,
            "spp": spp,
            "max_depth": max_depth,
            "filter": paths.pixel_filter_name,
            "emission": int(scene.any_emission),
        }
        key = images.key(paths.scene, standing.present[CURRENT], view, settings) if images else ""
        image = images.load(key, (*base.shape[:2], light_column(1))) if images else None
        if image is None:

            def part(done: float, group: int = group) -> None:
                progress("base image", (group + done) / count)

            traced = paths.render(
                view, frame_index=BASE_FRAME, seed=seed, spp=spp, max_depth=max_depth, progress=part, scene=scene
            )
            image = np.concatenate([traced.hdr, traced.albedo, traced.normal], axis=-1)
            if images:
                images.save(key, image)
        column, others = light_column(group), slice(AUXILIARY, light_column(1))
        base[..., column : column + 3] = image[..., :3]
        base[..., others] = np.maximum(base[..., others], image[..., others]) if group else image[..., others]
    return base
