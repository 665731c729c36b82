# SPDX-License-Identifier: Apache-2.0
"""Panorama: radiance that reaches one point from the static scene, for cells of a cube around it.

Each face of the cube is divided into pages, each the image of a pinhole camera with an offset aperture, and these into
tiles. All cells of a tile are traced when a view first needs one. Cells far from the center of a face subtend less and
have fewer samples, so that samples are about equally dense in solid angle. A quarter of these samples is traced first.
Only tiles in which light varies then get all of them besides: elsewhere, what is between neighbors is noise, which the
denoiser removes.

Blocks of tiles are denoised once, together with the tiles around them. So that blocks at the edges of a face
have such tiles too, a margin of one tile continues the plane of each face. A block has coarse cells besides, each the
mean of 2 x 2 cells: where these and the cells around lie on one surface, a pixel interpolates between four of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tiscene.render.film.denoise import denoise
from tiscene.render.film.upsample import ALBEDO_OFFSET
from tiscene.render.integrators.incremental.base_image import ProgressCallback, scene_under_group
from tiscene.render.integrators.incremental.path_recording import AUXILIARY, light_column
from tiscene.render.integrators.labels.first_hits import first_hits
from tiscene.render.integrators.labels.label_kernels import primary_rays
from tiscene.render.integrators.panorama import panorama_kernels as kernels
from tiscene.render.integrators.panorama.cell_files import CellFiles
from tiscene.render.integrators.panorama.cell_store import CellStore
from tiscene.render.integrators.panorama.light_probe import FACES, PLANE, SIZE, LightProbe, face_view, trace_probe
from tiscene.render.integrators.panorama.panorama_kernels import BLOCK, BLOCK_ROWS, TILE, WINDOW
from tiscene.render.integrators.panorama.reprojection import Reprojection
from tiscene.render.integrators.panorama.reprojection_kernels import ALL_KNOWN, EDGE, FAR
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import FEATURE_COLUMNS
from tiscene.render.intersect.ray_queue import RayArrays
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import View
from tiscene.scene.camera import Vector3
from tiscene.scene.placement import CURRENT, Placement

FloatImage = NDArray[np.float32]

PAGE = 32 * TILE  # cells along a side of a page
CELL = 0.35  # width of a cell at the center of a face, px at the center of the image
FIRST_FRAME = -1000  # frame number of the random numbers of the first page; the next ones count down
FIRST_DIVISOR, LEAST_SPP = 4, 4  # cells have their samples divided by this first, but no fewer than so many
FURTHER_FRAME = -2  # frame number that sets the random numbers of further samples apart
CONTRAST = 0.25  # of the light in a tile, from which it has further samples
DIM = 0.3  # of the mean light: the offset of `contrast_of`
FINE_SPP = 128  # samples per pixel from which the denoiser's best quality pays
_BATCH = 64  # blocks whose cells are copied at once


@dataclass(frozen=True)
class PanoramaSettings:
    """What the cells of a panorama depend on besides the scene.

    Attributes:
        center: The point, world, m.
        faces: Cells along a side of a face.
        spp: Samples per solid angle of a pixel at the center of the image, where light varies.
        max_depth: Largest number of segments of a path.
        seed: Seed of the random numbers.
    """

    center: Vector3
    faces: int
    spp: int
    max_depth: int
    seed: int

    @property
    def denoiser(self) -> str:
        """Quality of OIDN."""
        return "high" if self.spp >= FINE_SPP else "fast"

    @classmethod
    def of(cls, view: View, center: Vector3, *, spp: int, max_depth: int, seed: int) -> PanoramaSettings:
        """Return the settings of the panorama around a center that serves a view."""
        pixel = 2.0 * math.tan(0.5 * view.current.vertical_fov) / view.height
        faces = math.ceil(2.0 / (CELL * pixel) / BLOCK) * BLOCK
        return cls(center, faces, spp, max_depth, seed)

    def page_view(self, face: int, row: int, column: int, border: int = 0) -> View:
        """Return the view of a page, whose pixels are its cells. Pages begin at the margin.

        Args:
            face: Of the cube.
            row: Of the page.
            column: Of the page.
            border: Width of an additional border, in cells.
        """
        size = PAGE + 2 * border
        middle = ((np.array([column, row]) + 0.5) * PAGE - TILE) * (2.0 / self.faces) - 1.0
        return face_view(self.center, face, size, size / self.faces, (float(middle[0]), float(-middle[1])))

    def samples(self, page_view: View) -> int:
        """Return the samples per cell of a page, where light varies.

        Always a power of two: other numbers leave out the same part of the sample space in every cell, so that the
        error does not average out over cells.
        """
        right, up = page_view.current.aperture_offset
        return 1 << max(0, round(math.log2(self.spp * CELL**2 * (1.0 + right**2 + up**2) ** -1.5)))


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
        paths: Path tracer of pages, of PAGE x PAGE pixels.
        probe_paths: Path tracer of the light probe, see `trace_probe`.
        static: Placement without the movers, see `base_placement`.
        settings: What the cells depend on besides.
        files: Cells on disk; None: none.
        key: Digest of everything that the cells depend on, which names the files.
    """

    def __init__(
        self,
        paths: PathPass,
        probe_paths: PathPass,
        static: Placement,
        settings: PanoramaSettings,
        files: CellFiles | None = None,
        key: str = "",
    ) -> None:
        self.settings = settings
        self._paths, self._probe_paths, self._static = paths, probe_paths, static
        groups = static.light_groups
        self.groups = 1 if groups is None else len(groups.factors)
        self._columns = light_column(self.groups)  # of light, albedo and normal; then comes the distance
        self._rays = RayArrays()
        self._files, self._key = files, key
        self._probe: LightProbe | None = None
        self._tiles: CellStore | None = None
        self._tiles_along, blocks = settings.faces // TILE + 2, settings.faces // BLOCK  # a side of a face
        self._pages_along = -(-self._tiles_along * TILE // PAGE)
        # Blocks have all that views need: the columns of tiles, with the denoised light before the distance.
        self._shown_columns = self._columns + 3 * self.groups
        self._blocks = CellStore((6, blocks, blocks), BLOCK_ROWS, self._shown_columns + 1, files, f"{key}-blocks")

    @property
    def bytes(self) -> int:
        """Memory of the cells and of the light probe."""
        return self.bytes_with(_NOTHING)

    def bytes_with(self, missing: Missing) -> int:
        """Return the memory with room for cells that are missing."""
        tiles = self._tiles.bytes_with(len(missing.tiles)) if self._tiles else 0
        blocks = self._blocks.bytes_with(len(missing.blocks))
        return tiles + blocks + (self._probe.bytes if self._probe else 0)

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
        size, even = (view.array(), view.width, view.height), np.empty((view.height, view.width), np.int32)
        if kernels.resample_even(*size, *cells, even):
            return None
        if kernels.resample(np.flatnonzero(even == 0).astype(np.int32), *size, *cells):
            return None
        return images, np.full((view.height, view.width), ALL_KNOWN, np.int32)

    def probe(self) -> LightProbe:
        """Return the light all around, from disk if it is there. Tracing it changes what the scene has placed."""
        if self._probe is None:
            columns, settings, files = PLANE + 3 * self.groups, self.settings, self._files
            cells = files.load(f"{self._key}-probe", SIZE * SIZE, columns, np.float32)[1] if files else None
            if cells is None or len(cells) < FACES:
                depth = max(1, settings.max_depth - 1)  # paths that end in the probe have one segment more
                cells = trace_probe(
                    self._probe_paths, self._place, self.groups, settings.center, seed=settings.seed, max_depth=depth
                )
                self._place(0)
                if files:
                    files.append(f"{self._key}-probe", np.arange(FACES, dtype=np.int32), cells)
            self._probe = LightProbe(settings.center, cells)
        return self._probe

    def complete(self, missing: Missing, view: View, progress: ProgressCallback) -> None:
        """Trace and denoise what is missing. Changes what the scene has placed.

        Args:
            missing: Of `missing()`.
            view: The view that it is for, which has the background.
            progress: Called with "panorama" and the completed fraction.
        """
        self._trace(missing.tiles, view, progress)
        for first in range(0, len(missing.blocks), _BATCH):
            self._denoise(missing.blocks[first : first + _BATCH])

    def _trace(self, tiles: NDArray[np.int64], view: View, progress: ProgressCallback) -> None:
        """Trace tiles."""
        cells = np.zeros((len(tiles), TILE * TILE, self._columns + 1), np.float32)
        features = slice(AUXILIARY, AUXILIARY + FEATURE_COLUMNS)
        pages = list(self._pages(tiles))
        done, total = 0, len(tiles) * self.groups
        probe = self.probe()
        for group in range(self.groups):
            self._place(group)
            scene = replace(scene_under_group(self._paths, group, None), cache=probe.cache_of_group(group))
            light, dim = slice(light_column(group), light_column(group) + 3), DIM * probe.mean_light(group)
            for number, page_view, members in pages:
                corners = tiles[members, 1:] % (PAGE // TILE) * TILE
                shown = replace(page_view, background=view.background)
                means = self._sampled(shown, FIRST_FRAME - number, corners, scene, dim)
                cells[members, :, light] = means[..., :3]
                # Features are merged as those of base images, see `render_base_image`.
                merged = (
                    np.maximum(cells[members, :, features], means[..., features]) if group else means[..., features]
                )
                cells[members, :, features] = merged
                done += len(members)
                progress("panorama", done / total)
        self._place(0)
        for number, _, members in pages:
            cells[members, :, self._columns] = self._distances(number, tiles[members, 1:] % (PAGE // TILE) * TILE)
        self._tile_store().add(tiles, cells)

    def _sampled(self, view: View, frame: int, corners: NDArray[np.int64], scene: PathScene, dim: float) -> FloatImage:
        """Trace cells and return the means of their samples, float32 [n, TILE * TILE, FILM_COLUMNS].

        Args:
            view: View of the page.
            frame: Frame number of its random numbers.
            corners: [n, 2], row and column on it of the first cell of tiles.
            scene: Scene data.
            dim: Offset of `contrast_of`.
        """
        settings, spp = self.settings, self.settings.samples(view)
        first_spp = max(LEAST_SPP, spp // FIRST_DIVISOR)

        def sums(corners: NDArray[np.int64], spp: int, seed: int) -> FloatImage:
            rows = self._paths.sums(
                view, _squares(corners[:, 0] * PAGE + corners[:, 1], PAGE),
                spp=spp, key=frame_key(seed, frame), max_depth=settings.max_depth, scene=scene,
            )  # fmt: skip
            return rows.reshape(len(corners), TILE * TILE, -1)

        result = sums(corners, first_spp, settings.seed) / np.float32(first_spp)
        varied = contrast_of(result, dim) > CONTRAST
        if varied.any():
            further = sums(corners[varied], spp, frame_key(settings.seed, FURTHER_FRAME))
            result[varied] = (result[varied] * np.float32(first_spp) + further) / np.float32(first_spp + spp)
        return result

    def _distances(self, page: int, corners: NDArray[np.int64]) -> NDArray[np.float32]:
        """Return how far away the centers of cells show surfaces, m; less zero behind the edge of a nearer surface.

        Args:
            page: Number of the page.
            corners: [n, 2], row and column on it of the first cell of tiles.

        Returns:
            float32 [n, TILE * TILE].
        """
        border = self._page_view(page, border=1)
        squares = _squares(corners[:, 0] * border.width + corners[:, 1], border.width, TILE + 2)
        rays = self._rays.resized(border.width, border.height)
        chosen = np.zeros((border.height, border.width), bool)
        chosen.ravel()[squares] = True
        queue, count = rays.queue_of(chosen)
        primary_rays(queue, count, border.array(), border.width, border.height, rays.rays, False)
        first_hits(self._paths.scene, CURRENT, rays, queue, count)
        found = np.minimum(rays.hits.to_numpy()[squares, 0], FAR).reshape(-1, TILE + 2, TILE + 2)
        nearest = sliding_window_view(found, (3, 3), axis=(1, 2)).min(axis=(-2, -1))
        distances = found[:, 1:-1, 1:-1]
        signed: FloatImage = np.where(nearest < EDGE * distances, -distances, distances)
        return signed.reshape(len(corners), -1)

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
            shape = 6, self._tiles_along, self._tiles_along
            self._tiles = CellStore(shape, TILE * TILE, self._columns + 1, self._files, f"{self._key}-tiles")
        return self._tiles

    def _place(self, group: int) -> None:
        """Place the static scene with the lights of one group."""
        groups = self._static.light_groups
        self._paths.scene.place(
            self._static if groups is None else replace(self._static, lights=groups.only_group(group))
        )

    def _pages(self, tiles: NDArray[np.int64]) -> Iterator[tuple[int, View, NDArray[np.int64]]]:
        """Yield for each page with some of the tiles: its number, its view, and which tiles are its."""
        corner = tiles[:, 1:] // (PAGE // TILE)
        numbers = (tiles[:, 0] * self._pages_along + corner[:, 0]) * self._pages_along + corner[:, 1]
        for number in np.unique(numbers).tolist():
            yield number, self._page_view(number), np.flatnonzero(numbers == number)

    def _page_view(self, number: int, border: int = 0) -> View:
        """Return the view of a page; see `PanoramaSettings.page_view`."""
        face, row, column = np.unravel_index(number, (6, self._pages_along, self._pages_along))
        return self.settings.page_view(int(face), int(row), int(column), border)


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


def _squares(corners: NDArray[np.int64], stride: int, side: int = TILE) -> NDArray[np.int32]:
    """Return for each corner the rows of a square of side x side cells in an array of `stride` cells per row."""
    within = np.arange(side)[:, None] * stride + np.arange(side)
    rows: NDArray[np.int32] = (corners[:, None] + within.ravel()).ravel().astype(np.int32)
    return rows
