# SPDX-License-Identifier: Apache-2.0
"""Changes of the light on static surfaces by movers, found at reduced size.

A few paths through the static scene are recorded for each frame, and those that movers invalidate are traced again, as
in incremental rendering. Paths end in a light probe, where it knows their second surface: how movers change the light
of that surface is left out. What movers emit is path traced by itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tiscene.device.memory import upload_vectors
from tiscene.render.integrators.incremental.base_image import scene_under_group
from tiscene.render.integrators.incremental.base_lights import BaseLights
from tiscene.render.integrators.incremental.frame_scratch import FrameScratch
from tiscene.render.integrators.incremental.mover_bounds import cluster_boxes
from tiscene.render.integrators.incremental.mover_coverage import dilated
from tiscene.render.integrators.incremental.outlier_filter import filter_outliers
from tiscene.render.integrators.incremental.path_cache import PathCache, state_size
from tiscene.render.integrators.incremental.path_retracer import PathRetracer
from tiscene.render.integrators.panorama.light_probe import LightProbe
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_state import PathSamples, PathState
from tiscene.render.lights.intersect import MIRRORED, SCATTERED
from tiscene.render.sampling.sobol import index_bits
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_table import LightTable
from tiscene.scene.placement import CURRENT, Placement

FloatImage = NDArray[np.float32]

REDUCTION = 4  # factor along each axis by which the image is smaller
BESIDE = 2  # px of reduced size around movers where large changes are not upsampled: there edges of shadows are
LARGE = 0.06  # of the light before


class LightChanges:
    """What movers add to and take from the light of static surfaces, at reduced size.

    Args:
        scene: The scene.
        view: A view of the image size.
    """

    def __init__(self, scene: DeviceScene, view: View) -> None:
        reduced = reduced_view(view)
        self._paths = PathPass(scene, reduced.width, reduced.height)
        self._retracer = PathRetracer(self._paths, MIRRORED)
        self._mover_lights = LightTable()
        self._state: PathState | None = None
        self._scratch: FrameScratch | None = None

    def record(
        self,
        view: View,
        placement: Placement,
        moving: NDArray[np.bool_],
        probe: LightProbe,
        keys: Iterable[int],
        *,
        spp: int,
        max_depth: int,
    ) -> None:
        """Trace paths through the static scene, which is placed.

        Args:
            view: Camera and image size.
            placement: Placement of the frame.
            moving: bool [n], the movers.
            probe: Light of the static scene.
            keys: Keys of the random numbers of paths, and of those by which shadow rays pass partially opaque movers.
            spp: Paths per pixel of reduced size.
            max_depth: Largest number of segments of a path.
        """
        reduced = reduced_view(view)
        size = state_size(reduced.width * reduced.height, spp)
        if self._state is None or self._state.size < size:
            self._state = PathState(size)
        self._paths.background = view.background
        self._probe, self._lights = probe, BaseLights(self._paths.scene, placement.light_groups)
        scenes = [
            replace(scene_under_group(self._paths, group, self._lights), cache=probe.cache_of_group(group))
            for group in range(self._lights.groups)
        ]
        key, mover_key = keys
        # Where the view rests, the paths serve for other frames, in which movers are elsewhere.
        boxes = None if view.is_still else upload_vectors(self._boxes(placement, moving))
        samples = PathSamples(spp, index_bits(spp), key)
        self._cache = PathCache(
            self._paths, scenes, reduced, self._state,
            samples=samples, mover_key=mover_key, max_depth=max_depth, boxes=boxes,
        )  # fmt: skip
        if self._scratch is None or not self._scratch.fits([self._cache]):
            self._scratch = FrameScratch([self._cache])

    def _boxes(self, placement: Placement, moving: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Return `cluster_boxes` of the movers, float32 [6, BOXES]: they are not part of the scene that is placed."""
        boxes = self._paths.scene.instance_boxes[CURRENT, moving & placement.present[CURRENT]]
        return cluster_boxes(boxes[(boxes[:, :3] <= boxes[:, 3:]).all(axis=1)]).T  # without empty and unusable ones

    def find(self, moving: NDArray[np.bool_], factors: FloatImage) -> FloatImage:
        """Return the corrections of the recorded paths, float32 [h', w', CORRECTION_COLUMNS].

        Args:
            moving: bool [n], the movers, which the scene has placed.
            factors: float32 [groups, 3], intensity of each light group.
        """
        assert self._scratch is not None
        self._retracer.place_movers(moving)
        scene = replace(self._paths.scene_arrays(self._lights.scaled(factors)), cache=self._probe.cache(factors))
        for block in self._cache.blocks:
            self._retracer.retrace(scene, self._cache, block, self._cache.pixels, factors, self._scratch)
        rows: FloatImage = self._scratch.correction.to_numpy()
        return rows.reshape(self._paths.height, self._paths.width, -1)

    def light_of(self, emitting: NDArray[np.bool_], view: View, *, key: int, spp: int, max_depth: int) -> FloatImage:
        """Return what some movers emit and other surfaces scatter, radiance at reduced size, float32 [h', w', 3].

        Recorded paths rarely find small lamps. So their light is path traced by itself, with light sampling. What
        mirrors show of them is left out: recorded paths find that.

        Args:
            emitting: bool [n], the movers, which the scene has placed.
            view: Camera and image size.
            key: Seed of the random numbers.
            spp: Samples per pixel.
            max_depth: Largest number of segments of a path.
        """
        scene = self._paths.scene
        scene.place_mesh_lights(self._mover_lights, emitting)
        lit = self._paths.scene_arrays(self._mover_lights.arrays(scene.textures))
        image = self._paths.render(
            reduced_view(view), frame_index=0, seed=key, spp=spp, max_depth=max_depth, mis=SCATTERED,
            scene=replace(lit, any_links=False, any_shadow_links=False, first_group=False),
        )  # fmt: skip
        return image.hdr

    def without_outliers(self, radiance: FloatImage) -> FloatImage:
        """Return a static image of reduced size plus the corrections found last, without their outliers."""
        assert self._scratch is not None
        correction = self._scratch.correction.to_numpy()[:, :3].reshape(radiance.shape)
        return filter_outliers(self._scratch.correction, radiance + correction)


def changed_beside_movers(
    change: FloatImage, light: FloatImage, unknown: NDArray[np.bool_], movers: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return where movers change much of the light beside them, in means of 3x3 pixels, bool [h', w'].

    The shadow where a mover touches a surface is as wide as few pixels of reduced size, and the mover covers some.

    Args:
        change: What movers add to the radiance of static surfaces, float32 [h', w', 3].
        light: Their radiance without movers, float32 [h', w', 3].
        unknown: Where there is a mover before them, so that the change is not known, bool [h', w'].
        movers: Where movers are visible, bool [h', w'].
    """
    both = np.stack([change, light]).sum(axis=-1)
    known = np.pad(np.where(unknown, np.float32(0.0), both), ((0, 0), (1, 1), (1, 1)))
    changed, before = np.lib.stride_tricks.sliding_window_view(known, (3, 3), axis=(1, 2)).sum(axis=(-2, -1))
    for _ in range(BESIDE):
        movers = dilated(movers)
    result: NDArray[np.bool_] = movers & (np.abs(changed) > LARGE * before)
    return result


def reduced_view(view: View) -> View:
    """Return the view whose pixels are blocks of REDUCTION x REDUCTION pixels of another view, of a pinhole camera."""
    camera, width, height = view.current, -(-view.width // REDUCTION), -(-view.height // REDUCTION)
    pixel = 2.0 * math.tan(0.5 * camera.vertical_fov) / view.height
    right, up = camera.aperture_offset
    right += 0.5 * pixel * (REDUCTION * width - view.width)
    up -= 0.5 * pixel * (REDUCTION * height - view.height)
    fov = 2.0 * math.atan(0.5 * pixel * REDUCTION * height)
    camera = replace(camera, vertical_fov=fov, aperture_offset=(right, up))
    return replace(view, previous=camera, current=camera, next=camera, width=width, height=height)
