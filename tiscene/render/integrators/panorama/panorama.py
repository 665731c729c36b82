# SPDX-License-Identifier: Apache-2.0
"""Panorama: radiance that reaches one point from the static scene, for cells of a cube around it.

Each face of the cube is divided into tiles. All cells of a tile are traced when a view first needs one, a part of their
samples first. Only tiles in which light varies then get all of them besides: elsewhere, what is between neighbors is
noise, which the denoiser removes.

Blocks of tiles are denoised once, together with the tiles around them. So that blocks at the edges of a face
have such tiles too, a margin of one tile continues the plane of each face. A block has coarse cells besides, each the
mean of 2 x 2 cells: where these and the cells around lie on one surface, a pixel interpolates between four of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tiscene.render.film.denoise import denoise
from tiscene.render.film.upsample import ALBEDO_OFFSET
from tiscene.render.integrators.incremental.base_image import ProgressCallback, scene_under_group, under_each_group
from tiscene.render.integrators.incremental.path_recording import AUXILIARY, light_column
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.integrators.panorama import panorama_kernels as kernels
from tiscene.render.integrators.panorama.cell_files import CellFiles
from tiscene.render.integrators.panorama.cell_store import CellStore
from tiscene.render.integrators.panorama.light_probe import LightProbe, ProbeSampling
from tiscene.render.integrators.panorama.panorama_kernels import BLOCK, BLOCK_ROWS, TILE, WINDOW
from tiscene.render.integrators.panorama.reprojection import Reprojection
from tiscene.render.integrators.panorama.reprojection_kernels import ALL_KNOWN, EDGE, FAR
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import FEATURE_COLUMNS
from tiscene.render.intersect.ray_queue import RayWave
from tiscene.render.sampling.cube import FACE_ANGLE, FACES
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import SKY, CubeView, View
from tiscene.scene.camera import Vector3
from tiscene.scene.placement import CURRENT, Placement

FloatImage = NDArray[np.float32]

# Width of a cell, px at the center of the image. Where a camera turns, pixels are means of cells by area. Seen from an
# anchor, they have four points that interpolate between cells, where coarse ones blur more.
CELL_OF_CENTER, CELL_OF_ANCHOR = 0.42, 0.35
FIRST_FRAME = -1000  # frame number of the random numbers of cells
FIRST_DIVISOR, LEAST_SPP = 2, 4  # cells have their samples divided by this first, but no fewer than so many
PROBE_DIVISOR = 64  # of the samples per pixel: so, a light probe has a few percent of all paths
FURTHER_FRAME = -2  # frame number that sets the random numbers of further samples apart
# Contrast of the light in a tile from which it has further samples: below FINE_SPP, and from there on.
CONTRAST, FINE_CONTRAST = 0.25, 0.15
DIM = 0.3  # of the mean light: the offset of `contrast_of`
FINE_SPP = 128  # samples per pixel from which the denoiser's best quality pays, and noise hides less variation
_MAX_CELLS = (1 << 31) - 1  # whose numbers are int32
_BATCH = 64  # blocks whose cells are copied at once
ZOOM_STEP = math.sqrt(2.0)  # between the widths of pixels for which a camera that zooms has panoramas
_TILES_AT_ONCE = 1024  # whose paths are traced at once


@dataclass(frozen=True)
class PanoramaSettings:
    """What the cells of a panorama depend on besides the scene.

    Attributes:
        center: The point, world, m.
        cell: Width of a cell, px at the center of the image.
        faces: Cells along a side of a face.
        spp: Samples per solid angle of a pixel at the center of the image, where light varies.
        max_depth: Largest number of segments of a path.
        seed: Seed of the random numbers.
    """

    center: Vector3
    cell: float
    faces: int
    spp: int
    max_depth: int
    seed: int

    @property
    def denoiser(self) -> str:
        """Quality of OIDN."""
        return "high" if self._fine else "fast"

    @property
    def contrast(self) -> float:
        """Contrast of the light in a tile from which it has further samples."""
        return FINE_CONTRAST if self._fine else CONTRAST

    @property
    def _fine(self) -> bool:
        return self.spp >= FINE_SPP

    @classmethod
    def of(cls, view: View, center: Vector3, *, spp: int, max_depth: int, seed: int) -> PanoramaSettings:
        """Return the settings of the panorama around a center that serves a view."""
        pixel = 2.0 * math.tan(0.5 * view.current.vertical_fov) / view.height
        if view.zooms:  # a panorama serves a range of fields of view
            pixel = ZOOM_STEP ** math.floor(math.log(pixel, ZOOM_STEP))
        cell = CELL_OF_CENTER if center == view.current.position else CELL_OF_ANCHOR
        faces = math.ceil(FACE_ANGLE / (cell * pixel) / BLOCK) * BLOCK
        return cls(center, cell, faces, spp, max_depth, seed)

    @property
    def samples(self) -> int:
        """Samples per cell, where light varies.

        Always a power of two: other numbers leave out the same part of the sample space in every cell, so that the
        error does not average out over cells.
        """
        return 1 << max(0, round(math.log2(self.spp * self.cell**2)))

    @property
    def probe_sampling(self) -> ProbeSampling:
        """How to trace the light probe. Paths that end in it have one segment more."""
        return ProbeSampling(max(1, self.spp // PROBE_DIVISOR), self.seed, max(1, self.max_depth - 1))

    @property
    def possible(self) -> bool:
        """Whether the number of cells is possible: not for views of few degrees in large images."""
        view = self.cells_view(TILE + 1)
        return view.width * view.height <= _MAX_CELLS

    def cells_view(self, margin: int = TILE, background: tuple[float, float, float] = SKY) -> CubeView:
        """Return the view whose pixels are the cells, and those of a margin of each face."""
        return CubeView(self.center, self.faces, margin, background)


class Missing(NamedTuple):
    """What a view needs that a panorama does not have.

    Attributes:
        tiles: Tiles that are not traced, [n, 3]: face, row and column, counted from the margin.
        blocks: Blocks that are not denoised, [n, 3]: face, row and column.
    """

    tiles: NDArray[np.int64]
    blocks: NDArray[np.int64]


_NOTHING = Missing(np.zeros((0, 3), np.int64), np.zeros((0, 3), np.int64))


class Panorama:
    """Cells around a point, as far as they were needed.

    Args:
        paths: Path tracer.
        groups: Number of light groups.
        settings: What the cells depend on besides the scene.
        probe: The light all around, in which paths end.
        files: Cells on disk; None: none.
        key: Digest of everything that the cells depend on, which names the files.

    Attributes:
        settings: What the cells depend on besides the scene.
        probe: The light all around.
        groups: Number of light groups.
    """

    def __init__(
        self,
        paths: PathPass,
        groups: int,
        settings: PanoramaSettings,
        probe: LightProbe,
        files: CellFiles | None,
        key: str,
    ) -> None:
        self.settings, self.probe = settings, probe
        self._paths, self.groups = paths, groups
        self._columns = light_column(self.groups)  # of light, albedo and normal; then comes the distance
        self._rays = RayWave()
        self._files, self._key = files, key
        self._tiles: CellStore | None = None
        self._tiles_along, blocks = settings.faces // TILE + 2, settings.faces // BLOCK  # a side of a face
        # Blocks have all that views need: the columns of tiles, with the denoised light before the distance.
        self._shown_columns = self._columns + 3 * self.groups
        self._blocks = CellStore((FACES, blocks, blocks), BLOCK_ROWS, self._shown_columns + 1, files, f"{key}-blocks")

    @property
    def bytes(self) -> int:
        """Memory of the cells and of the light probe."""
        return self.bytes_with(_NOTHING)

    def bytes_with(self, missing: Missing) -> int:
        """Return the memory with room for cells that are missing."""
        tiles = self._tiles.bytes_with(len(missing.tiles)) if self._tiles else 0
        blocks = self._blocks.bytes_with(len(missing.blocks))
        return tiles + blocks + self.probe.bytes

    def clear(self) -> None:
        """Forget all cells."""
        if self._tiles:
            self._tiles.clear()
        self._blocks.clear()

    def missing(self, view: View, points: Reprojection | None = None) -> Missing:
        """Return what a view needs and is not there.

        Args:
            view: The view.
            points: What it shows, if it is seen from elsewhere than the center; None: it is seen from there.
        """
        found = np.zeros(self._blocks.slots.shape, np.int32)
        if points is None:
            kernels.find_blocks(view.array(), view.width, view.height, self.settings.faces, found)
        else:
            points.find_blocks(self.settings.faces, found)
        blocks = (found > 0) & (self._blocks.slots < 0)
        if not blocks.any():
            return _NOTHING
        tiles = self._tile_store().slots
        needed = np.zeros(tiles.shape, bool)
        side = BLOCK // TILE  # tiles along a side of a block; one more on each side belongs to its window
        for row, column in np.ndindex(side + 2, side + 2):
            rows, columns = (slice(first, first + side * blocks.shape[1], side) for first in (row, column))
            needed[:, rows, columns] |= blocks
        return Missing(np.argwhere(needed & (tiles < 0)), np.argwhere(blocks))

    def images(self, view: View, points: Reprojection | None = None) -> tuple[FloatImage, NDArray[np.int32]] | None:
        """Return the images of a view, or None if cells are missing; arguments as of `missing`.

        Returns:
            float32 [n, h, w, 3]: three columns each, see `light_column`; then the denoised light of the groups.
            int32 [h, w], which subpixels are known, see `reproject`: all of them, seen from the center.
        """
        blocks, columns = self._blocks, self._shown_columns
        images = np.empty((columns // 3, view.height, view.width, 3), np.float32)
        cells = *kernels.Blocks(self.settings.faces, blocks.slots, blocks.cells), columns, images
        if points is not None:
            known = points.images(*cells)
            return None if known is None else (images, known)
        size, missing = (view.array(), view.width, view.height), np.zeros(1, np.int32)
        even = np.zeros((view.height, view.width), np.int32)
        kernels.resample_even(*size, *cells, even, missing)
        kernels.resample(np.flatnonzero(even == 0).astype(np.int32), *size, *cells, missing)
        return None if missing.any() else (images, np.full((view.height, view.width), ALL_KNOWN, np.int32))

    def complete(self, missing: Missing, view: View, static: Placement, progress: ProgressCallback) -> None:
        """Trace and denoise what is missing. Changes what the scene has placed.

        Args:
            missing: Of `missing()`.
            view: The view that it is for, which has the background.
            static: Placement without the movers, see `base_placement`: the same static scene each time.
            progress: Called with "panorama" and the completed fraction.
        """
        self._trace(missing.tiles, view, under_each_group(static), progress)
        for first in range(0, len(missing.blocks), _BATCH):
            self._denoise(missing.blocks[first : first + _BATCH])

    def _trace(
        self, tiles: NDArray[np.int64], view: View, statics: list[Placement], progress: ProgressCallback
    ) -> None:
        """Trace tiles of the static scene under each light group."""
        cells = np.zeros((len(tiles), TILE * TILE, self._columns + 1), np.float32)
        features = slice(AUXILIARY, AUXILIARY + FEATURE_COLUMNS)
        parts = [slice(first, first + _TILES_AT_ONCE) for first in range(0, len(tiles), _TILES_AT_ONCE)]
        done, total = 0, len(tiles) * self.groups
        probe, shown = self.probe, self.settings.cells_view(background=view.background)
        for group, static in enumerate(statics):
            self._paths.scene.place(static)
            scene = replace(scene_under_group(self._paths, group, None), cache=probe.cache_of_group(group))
            light, dim = slice(light_column(group), light_column(group) + 3), DIM * probe.mean_light(group)
            for part in parts:
                means = self._sampled(shown, tiles[part], scene, dim)
                cells[part, :, light] = means[..., :3]
                # Features are merged as those of base images, see `render_base_image`.
                merged = np.maximum(cells[part, :, features], means[..., features]) if group else means[..., features]
                cells[part, :, features] = merged
                done += len(means)
                progress("panorama", done / total)
        self._paths.scene.place(statics[0])
        for part in parts:
            cells[part, :, self._columns] = self._distances(tiles[part])
        self._tile_store().add(tiles, cells)

    def _sampled(self, view: CubeView, tiles: NDArray[np.int64], scene: PathScene, dim: float) -> FloatImage:
        """Trace tiles and return the means of their samples, float32 [n, TILE * TILE, FILM_COLUMNS].

        Args:
            view: View of the cells.
            tiles: Tiles, [n, 3].
            scene: Scene data.
            dim: Offset of `contrast_of`.
        """
        settings, spp = self.settings, self.settings.samples
        first_spp = max(LEAST_SPP, spp // FIRST_DIVISOR)

        def sums(tiles: NDArray[np.int64], spp: int, seed: int) -> FloatImage:
            rows = self._paths.sums(
                view, _pixels_of(tiles, view), spp=spp, key=frame_key(seed, FIRST_FRAME), max_depth=settings.max_depth,
                scene=scene,
            )  # fmt: skip
            return rows.reshape(len(tiles), TILE * TILE, -1)

        result = sums(tiles, first_spp, settings.seed) / np.float32(first_spp)
        varied = contrast_of(result, dim) > settings.contrast
        if varied.any():
            further = sums(tiles[varied], spp, frame_key(settings.seed, FURTHER_FRAME))
            result[varied] = (result[varied] * np.float32(first_spp) + further) / np.float32(first_spp + spp)
        return result

    def _distances(self, tiles: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return how far away the centers of cells show surfaces, m; less zero behind the edge of a nearer surface.

        Args:
            tiles: Tiles, [n, 3].

        Returns:
            float32 [n, TILE * TILE].
        """
        view = self.settings.cells_view(TILE + 1)  # tiles have a border of a cell
        pixels = _pixels_of(tiles, view, TILE + 2)
        wave = self._rays.reserved(len(pixels))
        kernels.center_rays(pixels, view.array(), view.width, view.height, wave.rays)
        first_hits(self._paths.scene, CURRENT, wave, wave.queue, len(pixels))
        found = np.minimum(wave.hits.to_numpy()[: len(pixels), 0], FAR).reshape(-1, TILE + 2, TILE + 2)
        nearest = sliding_window_view(found, (3, 3), axis=(1, 2)).min(axis=(-2, -1))
        distances = found[:, 1:-1, 1:-1]
        signed: FloatImage = np.where(nearest < EDGE * distances, -distances, distances)
        return signed.reshape(len(tiles), -1)

    def _denoise(self, blocks: NDArray[np.int64]) -> None:
        """Denoise blocks whose windows are traced."""
        tiles, traced = self._tile_store(), self._columns
        windows = np.empty((len(blocks), WINDOW * WINDOW, self._blocks.columns), np.float32)
        kernels.gather_windows(blocks.astype(np.int32), tiles.slots, tiles.cells, tiles.columns, windows)
        for window in windows.reshape(-1, WINDOW, WINDOW, self._blocks.columns):
            albedo, normal = (window[..., first : first + 3] for first in (AUXILIARY, AUXILIARY + 3))
            for group in range(self.groups):
                column, clean_column = light_column(group), traced + 3 * group
                window[..., clean_column : clean_column + 3] = denoise(
                    window[..., column : column + 3], albedo, normal, self.settings.denoiser, clean=False
                )
        cells = np.empty((len(blocks), BLOCK_ROWS, self._blocks.columns), np.float32)
        kernels.fill_blocks(windows, AUXILIARY + 3, cells)
        self._blocks.add(blocks, cells)

    def _tile_store(self) -> CellStore:
        """Return the tiles. Views whose blocks are on disk do not need them: the first other view loads them."""
        if self._tiles is None:
            shape = FACES, self._tiles_along, self._tiles_along
            self._tiles = CellStore(shape, TILE * TILE, self._columns + 1, self._files, f"{self._key}-tiles")
        return self._tiles


def contrast_of(cells: FloatImage, offset: float) -> FloatImage:
    """Return how much light varies in tiles, 0..1: the contrast of the irradiance of their quarters, float32 [n].

    That of a quarter is the median of its cells: if few bright paths decided, they would be diluted by further samples
    where they happened to be found, and rooms became 1 % darker.

    Args:
        cells: float32 [n, TILE * TILE, at least 6], radiance and albedo.
        offset: Added to the irradiance, W/m²/sr, so that noise in the dark does not count.
    """
    irradiance = cells[..., :3].mean(axis=-1) / (cells[..., 3:6].mean(axis=-1) + np.float32(ALBEDO_OFFSET))
    by_quarter = irradiance.reshape(-1, 2, TILE // 2, 2, TILE // 2).swapaxes(2, 3).reshape(-1, 4, TILE * TILE // 4)
    quarters = np.median(by_quarter, axis=-1) + np.float32(offset)
    most, least = quarters.max(axis=-1), quarters.min(axis=-1)
    result: FloatImage = (most - least) / np.maximum(most + least, np.float32(1e-30))
    return result


def _pixels_of(tiles: NDArray[np.int64], view: CubeView, side: int = TILE) -> NDArray[np.int32]:
    """Return the pixels of tiles, tile by tile, int32 [n * side * side].

    Args:
        tiles: Tiles, [n, 3].
        view: View of the cells. If it has a larger margin than TILE, the first tile begins at its border.
        side: Pixels along a side of a tile, with its border.
    """
    corners = (tiles[:, 0] * view.width + tiles[:, 1] * TILE) * view.width + tiles[:, 2] * TILE
    within = np.arange(side)[:, None] * view.width + np.arange(side)
    pixels: NDArray[np.int32] = (corners[:, None] + within.ravel()).ravel().astype(np.int32)
    return pixels
