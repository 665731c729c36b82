# SPDX-License-Identifier: Apache-2.0
"""The base image of incremental rendering: radiance of the static scene under each light group, at many samples.

Light is linear: a frame's base is the sum of the groups' images times the groups' intensities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload
from tiscene.render.integrators.incremental.base_image_cache import BaseImageCache, digest_of
from tiscene.render.integrators.incremental.base_lights import BaseLights
from tiscene.render.integrators.incremental.mover_coverage import MoverCoverage
from tiscene.render.integrators.incremental.path_cache import PathCache
from tiscene.render.integrators.incremental.path_recording import AUXILIARY, light_column
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import CURRENT, Placement

BASE_FRAME = -1  # frame number of the base image's random numbers
NOISE_WEIGHT = 0.5  # weight of the cached paths' noise in the denoiser's version of the base image

FloatImage = NDArray[np.float32]
ProgressCallback = Callable[[str, float], None]  # takes a stage's name and its completed fraction, 0..1


def no_progress(stage: str, done: float) -> None:
    """Report nothing."""


@dataclass(frozen=True, eq=False)
class IncrementalBase:
    """Everything that the frames before one static scene, camera and set of lights share.

    Attributes:
        lights: The static scene's lights. Only these are sampled; emission of movers is found by BSDF sampling.
        image: Base image, float32 [h, w, 6 + 3 * groups], columns: see `light_column`.
        cache: Cached paths of all pixels.
        coverage: Measures the fraction of each pixel that movers cover.
        extra_cache: Further cached paths, for pixels in which a mover is visible.
        derived: Pairs of images that users of the base computed from it, by name; they live as long as the base.
    """

    lights: BaseLights
    image: FloatImage
    cache: PathCache
    coverage: MoverCoverage
    extra_cache: PathCache | None = None
    derived: dict[str, tuple[FloatImage, FloatImage]] = field(default_factory=dict)

    @cached_property
    def mean(self) -> Any:
        """Mean of all cached paths of each pixel, f32 [pixels, ...] on the device, see `PathCache.mean`."""
        if self.extra_cache is None:
            return self.cache.mean
        spp, extra_spp = self.cache.spp, self.extra_cache.spp
        total = spp * self.cache.mean.to_numpy() + extra_spp * self.extra_cache.mean.to_numpy()
        return upload(total / np.float32(spp + extra_spp))

    @property
    def caches(self) -> tuple[PathCache, ...]:
        """All cached paths."""
        return (self.cache, self.extra_cache) if self.extra_cache else (self.cache,)

    @property
    def mover_spp(self) -> int:
        """Cached paths per pixel in which a mover is visible."""
        return sum(cache.spp for cache in self.caches)

    @property
    def bytes(self) -> int:
        """Memory of the cached paths."""
        return sum(cache.bytes for cache in self.caches)

    @cached_property
    def noise_matched(self) -> FloatImage:
        """Light of the base image with part of the cached paths' noise, float32 [h, w, 3 * groups].

        Denoisers adapt to the noise around a pixel. Next to a clean base image they would keep the noise of movers as
        detail.
        """
        columns = [light_column(group) + c for group in range(self.lights.groups) for c in range(3)]
        clean = self.image[..., columns]
        noisy: FloatImage = clean + NOISE_WEIGHT * (self.mean.to_numpy()[:, columns].reshape(clean.shape) - clean)
        return np.ascontiguousarray(noisy)

    def channels(self, group: int = 0) -> tuple[FloatImage, FloatImage, FloatImage]:
        """Return radiance under a light group, albedo and normal, as contiguous arrays [h, w, 3]."""
        radiance, albedo, normal = (
            self.image[..., first : first + 3].copy() for first in (light_column(group), AUXILIARY, AUXILIARY + 3)
        )
        return radiance, albedo, normal

    def noise_matched_channels(self, group: int = 0) -> tuple[FloatImage, FloatImage, FloatImage]:
        """Return the same as `channels`, with the radiance of `noise_matched`."""
        _, albedo, normal = self.channels(group)
        return self.noise_matched[..., 3 * group : 3 * group + 3].copy(), albedo, normal


def base_placement(placement: Placement, moving: NDArray[np.bool_]) -> Placement:
    """Return the placement of a base: without the moving instances, all lights at maximum intensity.

    Args:
        placement: Placement of a frame.
        moving: bool [n], which instances move.
    """
    groups = placement.light_groups
    lights = placement.lights if groups is None else groups.lights
    return replace(placement, present=placement.present & ~moving, lights=lights)


def static_scene_key(scene: DeviceScene, placement: Placement, still: NDArray[np.bool_]) -> tuple[Any, ...]:
    """Return what distinguishes the static scene of a placement from others of the same DeviceScene, but for a camera.

    Args:
        scene: The scene.
        placement: Placement of a frame.
        still: bool [n], the instances of the static scene.
    """
    groups = placement.light_groups
    return (
        np.flatnonzero(still).tobytes(),
        placement.mesh[still].tobytes(),
        placement.world_from_object[CURRENT, still].tobytes(),
        None if placement.color is None else placement.color[CURRENT, still].tobytes(),
        digest_of(scene.lights_of(placement) if groups is None else [groups.lights, groups.group]),
        scene.materials.any_coverage,
        scene.materials.any_emission,
    )


def under_each_group(static: Placement) -> list[Placement]:
    """Return the placement of a base with the lights of each light group alone."""
    groups = static.light_groups
    if groups is None:
        return [static]
    return [replace(static, lights=groups.only_group(group)) for group in range(len(groups.factors))]


def scene_under_group(paths: PathPass, group: int, lights: BaseLights | None) -> PathScene:
    """Return the scene data under one light group. Emissive surfaces and backgrounds belong to group 0.

    Args:
        paths: Path tracer of the scene.
        group: The light group.
        lights: Lights of all groups; None: the lights of other groups are not placed.
    """
    if group == 0:
        return paths.scene_arrays(lights.only(0) if lights else None)
    if lights is None:
        paths.scene.lights.place_meshes([], np.zeros((0, 3, 4)))
    scene = paths.scene_arrays(lights.only(group) if lights else None)
    return replace(scene, any_emission=False, first_group=False)


def render_base_image(
    paths: PathPass,
    images: BaseImageCache | None,
    progress: ProgressCallback,
    view: View,
    static: Placement,
    *,
    seed: int,
    spp: int,
    max_depth: int,
) -> FloatImage:
    """Render the scene under each light group, or load it from disk. Changes what the scene has placed.

    The albedo of a visible light is its own emission under its group; the groups' features are merged by maximum.

    Args:
        paths: Path tracer of the image size.
        images: Disk cache of the groups' images; None: none.
        progress: Called with "base image" and the completed fraction.
        view: Camera and image size.
        static: Placement without the movers, see `base_placement`.
        seed: Seed of the random numbers.
        spp: Samples per pixel.
        max_depth: Largest number of segments of a path.

    Returns:
        float32 [h, w, 6 + 3 * groups], columns: see `light_column`.
    """
    placements = under_each_group(static)
    count = len(placements)
    base = np.empty((paths.height, paths.width, light_column(count)), np.float32)
    for group, placement in enumerate(placements):
        paths.scene.place(placement)
        scene = scene_under_group(paths, group, None)
        settings: dict[str, int | str] = {
            "seed": seed,
            "spp": spp,
            "max_depth": max_depth,
            "filter": paths.pixel_filter_name,
            "emission": int(scene.any_emission),
        }
        key = images.key(paths.scene, static.present[CURRENT], view, settings) if images else ""
        image = images.load(key, (*base.shape[:2], light_column(1))) if images else None
        if image is None:

            def report(done: float, group: int = group) -> None:
                progress("base image", (group + done) / count)

            traced = paths.render(
                view, frame_index=BASE_FRAME, seed=seed, spp=spp, max_depth=max_depth, progress=report, scene=scene
            )
            image = np.concatenate([traced.hdr, traced.albedo, traced.normal], axis=-1)
            if images:
                images.save(key, image)
        column, features = light_column(group), slice(AUXILIARY, light_column(1))
        base[..., column : column + 3] = image[..., :3]
        base[..., features] = np.maximum(base[..., features], image[..., features]) if group else image[..., features]
    return base
