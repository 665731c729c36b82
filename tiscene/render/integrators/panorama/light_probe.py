# SPDX-License-Identifier: Apache-2.0
"""Light probes: the light of the surfaces that the center of a panorama, or a point nearby, sees: coarse, all around.

The cells of panoramas, movers and hidden parts are lit by surfaces outside the view as well. Paths that reach a surface
that the probe knows end there, see `radiance_cache`. They come from anywhere, so a cell has the mean light that its
surface sends in all directions, its radiosity over pi. What the center itself sees of a wooden floor is the window's
reflection.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynamics.lru_cache import LRUCache
from tiscene.device.kernel_types import float8
from tiscene.device.memory import device_array, upload_vectors
from tiscene.render.integrators.incremental.base_image import scene_under_group
from tiscene.render.integrators.incremental.path_recording import AUXILIARY
from tiscene.render.integrators.labels.first_hits import center_hits
from tiscene.render.integrators.panorama.light_probe_kernels import look_from_random_directions
from tiscene.render.integrators.panorama.reprojection_kernels import FAR, find_surfaces
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_state import PathSamples, PathState
from tiscene.render.integrators.path.radiance_cache import ALIGNED, FLATNESS, RadianceCache
from tiscene.render.intersect.ray_queue import RayArrays
from tiscene.render.intersect.surface_interaction import geometry_of
from tiscene.render.sampling.cube import FACE_ANGLE, FACES
from tiscene.render.sampling.sobol import frame_key, index_bits
from tiscene.render.view import CubeView
from tiscene.scene.camera import Vector3
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.placement import Placement

FloatImage = NDArray[np.float32]

SIZE = 32  # cells along a side of a face
_SIDE = 6  # pixels along a side of a cell
PIXELS = _SIDE * SIZE  # along a side of a face
PLANE = 4  # columns of a cell's plane, before its light
_FRAME = -500  # frame number of the random numbers
LEAST_SHARE = 0.125  # of a cell's pixels that must show its plane


class ProbeSampling(NamedTuple):
    """How a light probe is traced.

    Attributes:
        spp: Paths per pixel of a face.
        seed: Seed of the random numbers.
        max_depth: Largest number of segments of a path.
    """

    spp: int
    seed: int
    max_depth: int


class LightProbe:
    """Light of surfaces around a point.

    Args:
        center: The point, world, m.
        cells: float32 [6, SIZE * SIZE, PLANE + 3 * groups], by face, row and column: normal, zero if the cell is not
            known; distance of the center from the surface's plane, m; and the radiosity over pi of each light group,
            W/m²/sr.
    """

    def __init__(self, center: Vector3, cells: FloatImage) -> None:
        self.center, self.cells = center, cells
        self._groups = (cells.shape[-1] - PLANE) // 3
        # By factors: each group alone, and all of a frame.
        self._caches: LRUCache[bytes, RadianceCache] = LRUCache(self._groups + 1)

    @property
    def bytes(self) -> int:
        """Memory of the cells, and of the copies on the device."""
        return self.cells.nbytes + len(self._caches) * FACES * SIZE * SIZE * 4 * 8

    def mean_light(self, group: int) -> float:
        """Return the mean radiance of all cells under one light group, W/m²/sr."""
        return float(self.cells[..., PLANE + 3 * group : PLANE + 3 * group + 3].mean())

    def cache(self, factors: FloatImage) -> RadianceCache:
        """Return the light under all groups.

        Args:
            factors: float32 [groups, 3], intensity of each light group.
        """
        return self._caches.get(factors.tobytes(), lambda: self._upload(factors))

    def cache_of_group(self, group: int) -> RadianceCache:
        """Return the light under one group alone."""
        return self.cache(np.eye(self._groups, dtype=np.float32)[group, :, None].repeat(3, axis=-1))

    def _upload(self, factors: FloatImage) -> RadianceCache:
        cells = self.cells.reshape(FACES * SIZE * SIZE, -1)
        light = (cells[:, PLANE:].reshape(len(cells), -1, 3) * factors).sum(axis=1)
        unused = np.zeros((len(cells), 1), np.float32)
        values = np.hstack([light, cells[:, 3:PLANE], cells[:, :3], unused])
        return RadianceCache(upload_vectors(values), SIZE, *self.center)


def trace_probe(paths: PathPass, statics: Sequence[Placement], center: Vector3, sampling: ProbeSampling) -> FloatImage:
    """Return the cells of a light probe. Changes what the scene has placed.

    Args:
        paths: Path tracer.
        statics: The static scene under each light group.
        center: The point, world, m.
        sampling: How to trace it.
    """
    spp, seed, max_depth = sampling
    paths.scene.place(statics[0])
    view = CubeView(center, PIXELS)
    pixels = np.arange(view.width * view.height, dtype=np.int32)
    surfaces, samples = _surfaces(paths.scene, view), PathSamples(spp, index_bits(spp), frame_key(seed, _FRAME))
    shown: FloatImage = surfaces.to_numpy()

    def replace_rays(state: PathState, first: int, count: int) -> None:
        look_from_random_directions(surfaces, *center, paths.pixels, first, count, *samples, state.rays)

    cells = np.zeros((FACES, SIZE * SIZE, PLANE + 3 * len(statics)), np.float32)
    for group, static in enumerate(statics):
        paths.scene.place(static)
        scene, first = scene_under_group(paths, group, None), PLANE + 3 * group
        film = paths.sums(
            view, pixels, spp=spp, key=samples.key, max_depth=max_depth, scene=scene, on_start=replace_rays
        )
        planes, light = _light_of_planes(shown, film / np.float32(spp))
        cells[..., first : first + 3] = light.reshape(FACES, SIZE * SIZE, -1)
        if group == 0:
            cells[..., :PLANE] = planes.reshape(FACES, SIZE * SIZE, -1)
    return cells


def _surfaces(scene: DeviceScene, view: CubeView) -> Any:
    """Return what the centers of pixels show, see `find_surfaces`, on the device."""
    rays = center_hits(scene, view, RayArrays())
    surfaces = device_array(float8, rays.count)
    info = scene.materials.arrays().info
    find_surfaces(rays.count, rays.rays, rays.hits, rays.hit_ids, *geometry_of(scene), info, surfaces)
    return surfaces


def _light_of_planes(surfaces: FloatImage, film: FloatImage) -> tuple[FloatImage, FloatImage]:
    """Return the plane that the middle of each cell shows, and the mean light of the pixels that show it.

    Args:
        surfaces: Of `find_surfaces`, float32 [pixels, 8].
        film: Of the same pixels, means, float32 [pixels, FILM_COLUMNS].

    Returns:
        Planes, float32 [cells, PLANE], and light, float32 [cells, 3].
    """
    seen_normal = film[:, AUXILIARY + 3 : AUXILIARY + 6]
    shown, light, seen = (_by_cell(each) for each in (surfaces, film[:, :3], seen_normal))
    middle = shown[:, _SIDE * _SIDE // 2 + _SIDE // 2]
    point, alike, normal = middle[:, :3], middle[:, 3], middle[:, 4:7]
    offset, distance = -(normal * point).sum(axis=-1), np.linalg.norm(point, axis=-1)
    from_plane = np.abs((shown[..., :3] * normal[:, None]).sum(axis=-1) + offset[:, None])
    aligned = (shown[..., 4:7] * normal[:, None]).sum(axis=-1) > ALIGNED
    # A path that meets a light first finds no normal.
    width = (FACE_ANGLE / SIZE) * distance[:, None]
    same = (from_plane < FLATNESS * width) & aligned & ((seen**2).sum(axis=-1) > 0.25)
    number = same.sum(axis=1)
    known = (number >= LEAST_SHARE * _SIDE * _SIDE) & (alike > 0.0) & (distance < 0.5 * FAR)
    mean = np.where(same[..., None], light, np.float32(0.0)).sum(axis=1) / np.maximum(number, 1)[:, None]
    planes = np.where(known[:, None], np.column_stack([normal, offset]), np.float32(0.0))
    return planes.astype(np.float32), mean.astype(np.float32)


def _by_cell(values: FloatImage) -> FloatImage:
    """Return the pixels of all faces by cell, [cells, _SIDE * _SIDE, columns]."""
    blocks = values.reshape(FACES * SIZE, _SIDE, SIZE, _SIDE, -1).swapaxes(1, 2)
    return blocks.reshape(FACES * SIZE * SIZE, _SIDE * _SIDE, -1)
