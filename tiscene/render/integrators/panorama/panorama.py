# SPDX-License-Identifier: Apache-2.0
"""Panorama: radiance that reaches one point from the static scene, for cells of a cube around it.

Each face of the cube is divided into pages, each the image of a pinhole camera with an offset aperture, and these into
tiles. All cells of a tile are traced when a view first shows one. Cells far from the center of a face subtend less and
have fewer samples, so that samples are about equally dense in solid angle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array
from tiscene.render.integrators.incremental.base_image import ProgressCallback, scene_under_group
from tiscene.render.integrators.incremental.path_recording import AUXILIARY, light_column
from tiscene.render.integrators.panorama import panorama_kernels as kernels
from tiscene.render.integrators.panorama.panorama_kernels import TILE
from tiscene.render.integrators.panorama.tile_files import TileFiles
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_state import FEATURE_COLUMNS
from tiscene.render.sampling.sobol import frame_key
from tiscene.render.view import View
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.placement import Placement

PAGE = 16 * TILE  # cells along a side of a page
CELL = 0.35  # width of a cell at the center of a face, px at the center of the image
FIRST_FRAME = -1000  # frame number of the random numbers of the first page; the next ones count down
_CELLS = TILE * TILE
_FIRST_TILES = 1024  # that there is room for at first


@dataclass(frozen=True)
class PanoramaSettings:
    """What the cells of a panorama depend on besides the scene.

    Attributes:
        center: Position of the camera, m.
        faces: Cells along a side of a face.
        spp: Samples per solid angle of a pixel at the center of the image.
        max_depth: Largest number of segments of a path.
        seed: Seed of the random numbers.
    """

    center: Vector3
    faces: int
    spp: int
    max_depth: int
    seed: int

    @classmethod
    def of(cls, view: View, *, spp: int, max_depth: int, seed: int) -> PanoramaSettings:
        """Return the settings of the panorama that serves a view."""
        pixel = 2.0 * math.tan(0.5 * view.current.vertical_fov) / view.height
        faces = math.ceil(2.0 / (CELL * pixel) / TILE) * TILE
        return cls(view.current.position, faces, spp, max_depth, seed)

    def page_view(self, face: int, row: int, column: int) -> View:
        """Return the view of a page, whose pixels are its cells."""
        axes = np.eye(3)
        ahead = axes[face // 2] * (1.0 if face % 2 else -1.0)
        center = self.center
        middle = (np.array([column, row]) + 0.5) * (2.0 * PAGE / self.faces) - 1.0
        camera = Camera.look_at(
            center,
            (center[0] + ahead[0], center[1] + ahead[1], center[2] + ahead[2]),
            tuple(-axes[(face // 2 + 2) % 3]),
            vertical_fov=2.0 * math.atan(PAGE / self.faces),
            aperture_offset=(float(middle[0]), float(-middle[1])),
        )
        return View(camera, camera, camera, PAGE, PAGE)

    def samples(self, page_view: View) -> int:
        """Return the samples per cell of a page.

        Always a power of two: other numbers leave out the same part of the sample space in every cell, so that the
        error does not average out over cells.
        """
        right, up = page_view.current.aperture_offset
        return 1 << max(0, round(math.log2(self.spp * CELL**2 * (1.0 + right**2 + up**2) ** -1.5)))


class Panorama:
    """Cells around a point, as far as they were needed.

    Args:
        paths: Path tracer of pages, of PAGE x PAGE pixels.
        static: Placement without the movers, see `base_placement`.
        settings: What the cells depend on besides.
        files: Tiles on disk; None: none.
        key: Digest of everything that the cells depend on, which names the files.
    """

    def __init__(
        self,
        paths: PathPass,
        static: Placement,
        settings: PanoramaSettings,
        files: TileFiles | None = None,
        key: str = "",
    ) -> None:
        self.settings = settings
        self._files, self._key = files, key
        self._paths, self._static = paths, static
        self._tiles = settings.faces // TILE  # along a side of a face
        self._slots = np.full((6, self._tiles, self._tiles), -1, np.int32)
        self._used = 0
        groups = static.light_groups
        self.groups = 1 if groups is None else len(groups.factors)
        self._cells = device_array(ti.f32, (_FIRST_TILES * _CELLS, light_column(self.groups)))
        self._saved = np.empty(0, np.int32)  # numbers of the tiles on disk
        if files:
            self._saved, cells = files.load(key, light_column(self.groups))
            self._store(self._saved, cells)

    @property
    def bytes(self) -> int:
        """Memory of the cells."""
        return 4 * int(np.prod(self._cells.shape))

    def bytes_with(self, tiles: int) -> int:
        """Return the memory of the cells with room for further tiles."""
        return 4 * self._room(self._used + tiles) * _CELLS * int(light_column(self.groups))

    def clear(self) -> None:
        """Forget all cells."""
        self._slots.fill(-1)
        self._used = 0

    def missing(self, view: View) -> NDArray[np.int64]:
        """Return the tiles that a view shows and that are not traced, [n, 3]: face, row and column."""
        needed = np.zeros(self._slots.shape, np.int32)
        kernels.find_tiles(view.array(), view.width, view.height, self.settings.faces, needed)
        return np.argwhere((needed > 0) & (self._slots < 0))

    def image(self, view: View) -> NDArray[np.float32]:
        """Return the image of a view whose tiles are traced, float32 [h, w, columns], columns: see `light_column`."""
        image = np.empty((view.height, view.width, light_column(self.groups)), np.float32)
        kernels.resample(
            view.array(), view.width, view.height, self.settings.faces, self._slots, self._cells,
            light_column(self.groups), image,
        )  # fmt: skip
        return image

    def trace(self, tiles: NDArray[np.int64], view: View, progress: ProgressCallback) -> None:
        """Trace tiles that are missing. Changes what the scene has placed.

        Args:
            tiles: Of `missing`.
            view: The view that they are for, which has the background.
            progress: Called with "panorama" and the completed fraction.
        """
        cells = np.zeros((len(tiles), _CELLS, light_column(self.groups)), np.float32)
        features = slice(AUXILIARY, AUXILIARY + FEATURE_COLUMNS)
        pages = list(self._pages(tiles))
        done, total = 0, len(tiles) * self.groups
        for group in range(self.groups):
            self._place(group)
            scene = scene_under_group(self._paths, group, None)
            light = slice(light_column(group), light_column(group) + 3)
            for number, page_view, members in pages:
                first = tiles[members, 1:] % (PAGE // TILE) * TILE
                spp = self.settings.samples(page_view)
                sums = self._paths.sums(
                    replace(page_view, background=view.background), _squares(first[:, 0] * PAGE + first[:, 1], PAGE),
                    spp=spp, key=frame_key(self.settings.seed, FIRST_FRAME - number),
                    max_depth=self.settings.max_depth, scene=scene,
                )  # fmt: skip
                means = sums.reshape(len(members), _CELLS, -1) / np.float32(spp)
                cells[members, :, light] = means[..., :3]
                # Features are merged as those of base images, see `render_base_image`.
                cells[members, :, features] = np.maximum(cells[members, :, features], means[..., features])
                done += len(members)
                progress("panorama", done / total)
        numbers = np.ravel_multi_index(tuple(tiles.T), self._slots.shape).astype(np.int32)
        self._store(numbers, cells)
        if self._files:
            unsaved = ~np.isin(numbers, self._saved)
            self._files.append(self._key, numbers[unsaved], cells[unsaved])
            self._saved = np.append(self._saved, numbers[unsaved])

    def _store(self, numbers: NDArray[np.int32], cells: NDArray[np.float32]) -> None:
        """Keep tiles.

        Args:
            numbers: int32 [n], numbers of the tiles, by face, row and column.
            cells: float32 [n, TILE * TILE, columns].
        """
        self._reserve(self._used + len(numbers))
        slots = self._used + np.arange(len(numbers), dtype=np.int32)
        kernels.store_tiles(cells, slots, cells.shape[2], self._cells)
        self._slots.ravel()[numbers] = slots
        self._used += len(numbers)

    def _place(self, group: int) -> None:
        """Place the static scene with the lights of one group."""
        groups = self._static.light_groups
        self._paths.scene.place(
            self._static if groups is None else replace(self._static, lights=groups.only_group(group))
        )

    def _pages(self, tiles: NDArray[np.int64]) -> Iterator[tuple[int, View, NDArray[np.int64]]]:
        """Yield for each page with some of the tiles: its number, its view, and which tiles are its."""
        along = -(-self._tiles * TILE // PAGE)
        corner = tiles[:, 1:] // (PAGE // TILE)
        numbers = (tiles[:, 0] * along + corner[:, 0]) * along + corner[:, 1]
        for number in np.unique(numbers):
            members = np.flatnonzero(numbers == number)
            face, (row, column) = int(tiles[members[0], 0]), corner[members[0]]
            yield int(number), self.settings.page_view(face, int(row), int(column)), members

    def _room(self, tiles: int) -> int:
        """Return for how many tiles there is room once there is for a number of them; it doubles."""
        room = int(self._cells.shape[0]) // _CELLS
        return room if tiles <= room else max(tiles, 2 * room)

    def _reserve(self, tiles: int) -> None:
        """Make room for a number of tiles."""
        room = self._room(tiles)
        if room * _CELLS > self._cells.shape[0]:
            old = self._cells.to_numpy()
            self._cells = device_array(ti.f32, (room * _CELLS, light_column(self.groups)))
            cells = np.zeros(self._cells.shape, np.float32)
            cells[: len(old)] = old
            self._cells.from_numpy(cells)


def _squares(corners: NDArray[np.int64], stride: int) -> NDArray[np.int32]:
    """Return for each corner the rows of a square of TILE x TILE cells in an array of `stride` cells per row."""
    within = np.arange(TILE)[:, None] * stride + np.arange(TILE)
    rows: NDArray[np.int32] = (corners[:, None] + within.ravel()).ravel().astype(np.int32)
    return rows
