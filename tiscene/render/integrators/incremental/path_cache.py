# SPDX-License-Identifier: Apache-2.0
"""The paths of a scene without its movers, kept so that a frame need only trace again what a mover cuts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array, upload
from tiscene.render.integrators.incremental import path_recording as record
from tiscene.render.integrators.path.path_pass import PathPass, PathScene
from tiscene.render.integrators.path.path_state import CHUNK, FEATURE_COLUMNS, PathState
from tiscene.render.intersect.ray_queue import ray, tiled_order, upload_pixels
from tiscene.render.view import View

BLOCK = 1 << 18  # paths traced and kept together


@dataclass(frozen=True, eq=False)
class Block:
    """The rows (see replay_record) of the paths first .. first + count - 1. number: which block of the cache it is.

    offsets: i32 [count + 1], where each path's rows begin. rays: f32 [rows, 8]. light: f32 [rows, 3].
    restore: f32 [segments, 11]. features: f32 [count, 6].
    """

    number: int
    first: int
    count: int
    rows: int
    offsets: Any
    rays: Any
    light: Any
    restore: Any
    features: Any

    @cached_property
    def starts(self) -> NDArray[np.int32]:
        """`offsets` on the host."""
        starts: NDArray[np.int32] = self.offsets.to_numpy()
        return starts

    @property
    def bytes(self) -> int:
        """What it takes of memory."""
        arrays = (self.offsets, self.rays, self.light, self.restore, self.features)
        return sum(4 * int(np.prod(array.shape + array.element_shape)) for array in arrays)


def block_size(spp: int) -> int:
    """Paths of a block: whole pixels."""
    return max(1, BLOCK // spp) * spp


def room_for(pixels: int, spp: int) -> int:
    """How many paths must have room at a time to keep `spp` of each pixel."""
    return -(-min(block_size(spp), pixels * spp) // CHUNK) * CHUNK


class PathCache:
    """`spp` paths a pixel through what a DeviceScene has placed at CURRENT, which should be all but the movers.

    order, pixels: i32 [pixels], rows y * width + x in the order of the paths; `upload_pixels` of them.
    mean: f32 [pixels, 6 + 3 * groups], what the paths show, columns as `light_column` says.
    """

    def __init__(
        self,
        paths: PathPass,
        scenes: Sequence[PathScene],
        view: View,
        state: PathState,
        *,
        numbers: tuple[int, int, int],
        movers_key: int,
        max_depth: int,
    ) -> None:
        """scenes: the same but for the lights that shine, one for each group. state: see `room_for`.

        numbers: paths per pixel, bits that count them, the key of their random numbers; movers_key: of those that
        say whether a shadow ray passes through a mover.
        """
        self.numbers = numbers
        self.movers_key = movers_key
        self.max_depth = max_depth
        self.steps = scenes[0].steps(max_depth)
        self.size = view.width, view.height
        self.order = tiled_order(*self.size)
        self.pixels = upload_pixels(self.order, *self.size)
        self._paths, self._scenes, self._view = paths, scenes, view
        spp = numbers[0]
        pixel_count = view.width * view.height
        self.mean = device_array(ti.f32, (pixel_count, record.light_column(len(scenes))))
        self._block_size = block_size(spp)
        total = pixel_count * spp
        self.state = state
        self.blocks = [
            self._trace(number, min(self._block_size, total - number * self._block_size))
            for number in range(-(-total // self._block_size))
        ]

    @property
    def bytes(self) -> int:
        """What it takes of memory, but for what does not grow with the number of paths."""
        return sum(block.bytes for block in self.blocks)

    @property
    def most_rows(self) -> int:
        """How many rows are ever tested together."""
        return max(block.rows for block in self.blocks)

    def _trace(self, number: int, count: int) -> Block:
        first = number * self._block_size
        segment_counts, shadow_counts = (upload(np.zeros(count, np.int32)) for _ in range(2))
        features = device_array(ti.f32, (count, FEATURE_COLUMNS))
        written: list[list[_Rows]] = [[] for _ in range(self.steps)]
        for group, scene in enumerate(self._scenes):
            self._trace_group(group, scene, first, count, written, segment_counts, shadow_counts)
            record.keep_features(count, group, self.state.features, features)
        counts = segment_counts.to_numpy(), shadow_counts.to_numpy()
        return self._sort(number, count, *counts, [each for step in written for each in step], features)

    def _trace_group(
        self,
        group: int,
        scene: PathScene,
        first: int,
        count: int,
        written: list[list[_Rows]],
        segment_counts: Any,
        shadow_counts: Any,
    ) -> None:
        """Trace a block under the lights of one group, and write down what it brings at each step."""
        s = self.state
        with self._paths.restricted_to(self.pixels):
            self._paths.start(self._view, s, first, count, self.numbers)
        live = count
        last_depth = self.max_depth - 1
        if self._paths.scene.materials.any_emission:
            last_depth = self.max_depth
        for step in range(self.steps):
            segments = _Rows(live, group, is_segment=True)
            record.begin_segments(
                s.queue, live, s.rays, s.state, s.status, segments.paths, segments.rays, segments.restore
            )
            ends = scene.ends_at_lights and step == self.max_depth - 1 > 0
            live, casts = self._paths.advance(scene, s, live, first, step, self.numbers, self.max_depth, 1)
            if not ends:  # else only the shadow rays that the segments became can bring light
                record.end_segments(
                    *scene.arrays.lighting[-3:], last_depth, group,
                    segments.paths, segments.count, s.hits, s.state, segments.restore, segments.rays, segments.light,
                    shadow_counts if group else segment_counts,
                )  # fmt: skip
                written[step].append(segments)
            if casts:
                shadows = _Rows(casts, group)
                record.begin_shadows(s.shadow_queue, casts, s.shadow_rays, shadows.paths, shadows.rays)
                self._paths.cast_shadows(scene, s, casts, first, step, self.numbers)
                record.end_shadows(
                    shadows.paths, casts, s.occluded, s.state, s.status, shadows.rays, shadows.light, shadow_counts
                )
                written[step].append(shadows)
            if not live:
                break

    def _sort(self, number: int, count: int, segments: Any, shadows: Any, written: list[_Rows], features: Any) -> Block:
        """What was written step by step, path by path."""
        first = number * self._block_size
        offsets = np.concatenate([[0], np.cumsum(shadows + segments)])
        first_segments = np.concatenate([[0], np.cumsum(segments)])
        rows, restorable = int(offsets[-1]), int(first_segments[-1])
        block = Block(
            number,
            first,
            count,
            rows,
            upload(offsets),
            device_array(ray, max(rows, 1)),
            device_array(ti.f32, (max(rows, 1), 3)),
            device_array(ti.f32, (max(restorable, 1), record.RESTART_COLUMNS)),
            features,
        )
        next_row, next_segment = upload(offsets), upload(first_segments)
        for each in written:
            if each.is_segment and each.group == 0:
                record.sort_segments(
                    each.paths, each.count, each.rays, each.light, each.restore, next_row, next_segment,
                    block.rays, block.light, block.restore,
                )  # fmt: skip
            else:
                record.sort_shadows(
                    each.paths, each.count, each.rays, each.light, next_row, each.group, block.rays, block.light
                )
        record.mean_of_paths(
            self.pixels, first, count, self.numbers[0], len(self._scenes),
            block.offsets, block.rays, block.light, features, self.mean,
        )  # fmt: skip
        return block


class _Rows:
    """The rows of one step under the lights of one group."""

    def __init__(self, count: int, group: int, is_segment: bool = False) -> None:
        self.count, self.group, self.is_segment = count, group, is_segment
        self.paths = device_array(ti.i32, (count,))
        self.rays = device_array(ray, count)
        self.light = device_array(ti.f32, (count, 3))
        self.restore = device_array(ti.f32, (count, record.RESTART_COLUMNS)) if is_segment else None
