# SPDX-License-Identifier: Apache-2.0
"""Cached paths of the static scene: each frame re-traces only those that movers invalidate.

`PathCache` traces `spp` paths per pixel once, through the scene without its movers, and stores them in blocks as rays,
light and restart states; see `path_recording` for the format.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import taichi as ti
from numpy.typing import NDArray

from tiscene.device.memory import device_array, nbytes, upload
from tiscene.render.integrators.incremental import path_recording as record
from tiscene.render.integrators.incremental.mover_culling import drop_far
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_scene import PathScene
from tiscene.render.integrators.path.path_state import CHUNK, FEATURE_COLUMNS, PathSamples, PathState
from tiscene.render.integrators.path.wavefront_kernels import compact
from tiscene.render.intersect.ray_queue import ray, tiled_order, upload_pixels
from tiscene.render.view import View

BLOCK = 1 << 18  # paths traced and stored together
_STEP = 1 << 10  # number of records that arrays have room for, so that few sizes occur


@dataclass(frozen=True, eq=False)
class PathBlock:
    """The records of paths first .. first + count - 1, on the device.

    Attributes:
        number: Index of the block in its cache.
        first: Number of the first path.
        count: Number of paths.
        rows: Number of records.
        offsets: i32 [count + 1], first record of each path.
        rays: f32 [rows, 8], recorded rays.
        light: f32 [rows, 3], light that is lost if a mover blocks the ray.
        restart: f32 [segments, RESTART_COLUMNS], restart state of each segment.
        features: f32 [count, FEATURE_COLUMNS], denoiser features.
    """

    number: int
    first: int
    count: int
    rows: int
    offsets: Any
    rays: Any
    light: Any
    restart: Any
    features: Any

    @cached_property
    def host_offsets(self) -> NDArray[np.int32]:
        """`offsets` as a NumPy array."""
        offsets: NDArray[np.int32] = self.offsets.to_numpy()
        return offsets

    @property
    def bytes(self) -> int:
        """Memory of the arrays."""
        return nbytes(self.offsets, self.rays, self.light, self.restart, self.features)


def block_size(spp: int) -> int:
    """Return the number of paths per block: those of whole pixels."""
    return max(1, BLOCK // spp) * spp


def state_size(pixels: int, spp: int) -> int:
    """Return the capacity that `PathState` needs for one block of `spp` paths per pixel."""
    return -(-min(block_size(spp), pixels * spp) // CHUNK) * CHUNK


class PathCache:
    """Recorded paths through a DeviceScene as placed at CURRENT, which should be without the movers.

    Args:
        paths: Path tracer of the image size.
        scenes: The scene under each light group alone, see `base_image.scene_under_group`.
        view: Camera and image size.
        state: Scratch arrays of at least `state_size` paths.
        samples: Paths per pixel and their random numbers.
        mover_key: Key of the random numbers by which shadow rays pass partially opaque movers.
        max_depth: Largest number of segments of a path.
        boxes: Boxes of the movers, see `cull_rays`: of the rays that leave the first surface of a path, only those near
            them are recorded. Paths that movers change only beyond their second surface are left out. None: all rays.

    Attributes:
        order: i32 [pixels], pixel numbers y * width + x in the order of the paths.
        pixels: The same on the device, see `upload_pixels`.
        mean: f32 [pixels, light_column(groups)] on the device, mean of the paths of each pixel.
        blocks: The records.
        steps: Largest number of segments, alpha-rejected hits included.
    """

    def __init__(
        self,
        paths: PathPass,
        scenes: Sequence[PathScene],
        view: View,
        state: PathState,
        *,
        samples: PathSamples,
        mover_key: int,
        max_depth: int,
        boxes: Any = None,
    ) -> None:
        self.samples = samples
        self.mover_key = mover_key
        self.max_depth = max_depth
        self.steps = scenes[0].steps(max_depth)
        self.size = view.width, view.height
        self.order = tiled_order(*self.size)
        self.pixels = upload_pixels(self.order, *self.size)
        self._paths, self._scenes, self._view, self._boxes = paths, scenes, view, boxes
        pixel_count = view.width * view.height
        self.mean = device_array(ti.f32, (pixel_count, record.light_column(len(scenes))))
        self._block_size = block_size(samples.spp)
        total = pixel_count * samples.spp
        self.state = state
        self.blocks = [
            self._record_block(number, min(self._block_size, total - number * self._block_size))
            for number in range(-(-total // self._block_size))
        ]

    @property
    def spp(self) -> int:
        """Cached paths per pixel."""
        return self.samples.spp

    @property
    def bytes(self) -> int:
        """Memory that grows with the number of paths."""
        return sum(block.bytes for block in self.blocks)

    @property
    def max_rows(self) -> int:
        """Largest number of records in a block."""
        return max(block.rows for block in self.blocks)

    def _record_block(self, number: int, count: int) -> PathBlock:
        """Trace the paths of a block under each light group and store their records sorted by path."""
        first = number * self._block_size
        segment_counts, shadow_counts = (upload(np.zeros(count, np.int32)) for _ in range(2))
        features = device_array(ti.f32, (count, FEATURE_COLUMNS))
        recorded: list[list[_StepRecords]] = [[] for _ in range(self.steps)]
        for group, scene in enumerate(self._scenes):
            self._trace_group(group, scene, first, count, recorded, segment_counts, shadow_counts)
            record.merge_features(count, group, self.state.features, features)
        counts = segment_counts.to_numpy(), shadow_counts.to_numpy()
        return self._sort(number, count, *counts, [each for step in recorded for each in step], features)

    def _trace_group(
        self,
        group: int,
        scene: PathScene,
        first: int,
        count: int,
        recorded: list[list[_StepRecords]],
        segment_counts: Any,
        shadow_counts: Any,
    ) -> None:
        """Trace a block under the lights of one group, and append to `recorded` the records of each step."""
        state = self.state
        with self._paths.restricted_to(self.pixels):
            self._paths.start(self._view, state, first, count, self.samples)
        live = count
        last_depth = self.max_depth - 1
        if self._paths.scene.materials.any_emission:
            last_depth = self.max_depth
        for step in range(self.steps):
            segments = _StepRecords(live, group, is_segment=True)
            record.record_segments(
                state.queue, live, state.rays, state.state, state.status,
                segments.paths, segments.rays, segments.restart,
            )  # fmt: skip
            # The last segments become shadow rays, which alone can bring light.
            is_finishing = scene.ends_at_lights and step == self.max_depth - 1 > 0
            live, shadow_count = self._paths.advance(scene, state, live, first, step, self.samples, self.max_depth)
            if step == 0 and self._boxes is not None:
                live, shadow_count = self._drop_far(count)
            if not is_finishing:
                record.record_segment_light(
                    *scene.lights, last_depth, group,
                    segments.paths, segments.count, state.hits, state.state, segments.restart, segments.rays,
                    segments.light, shadow_counts if group else segment_counts,
                )  # fmt: skip
                recorded[step].append(segments)
            if shadow_count:
                shadows = _StepRecords(shadow_count, group)
                record.record_shadow_rays(
                    state.shadow_queue, shadow_count, state.shadow_rays, shadows.paths, shadows.rays
                )
                self._paths.cast_shadows(scene, state, shadow_count, first, step, self.samples)
                record.record_shadow_light(
                    shadows.paths, shadow_count, state.occluded, state.state, state.status,
                    shadows.rays, shadows.light, shadow_counts,
                )  # fmt: skip
                recorded[step].append(shadows)
            if not live:
                break

    def _drop_far(self, count: int) -> tuple[int, int]:
        """Keep those of the first `count` paths that come near a mover, and of their shadow rays, in the queues."""
        state = self.state
        state.swap_queues()  # back to the paths before the step
        with self._paths.vector_mode():
            drop_far(state.queue, count, state.rays, state.shadow_rays, self._boxes, state.status)
        return compact(state, count)

    def _sort(
        self, number: int, count: int, segments: Any, shadows: Any, recorded: list[_StepRecords], features: Any
    ) -> PathBlock:
        """Return the block of records that were made step by step, sorted by path.

        Args:
            number: Index of the block.
            count: Number of paths.
            segments: i32 [count], number of segments of each path.
            shadows: i32 [count], number of its shadow rays.
            recorded: The records, in order of the steps.
            features: f32 [count, FEATURE_COLUMNS] on the device.
        """
        first = number * self._block_size
        offsets = np.concatenate([[0], np.cumsum(shadows + segments)])
        first_segments = np.concatenate([[0], np.cumsum(segments)])
        rows, restarts = int(offsets[-1]), int(first_segments[-1])
        block = PathBlock(
            number,
            first,
            count,
            rows,
            upload(offsets),
            device_array(ray, max(rows, 1)),
            device_array(ti.f32, (max(rows, 1), 3)),
            device_array(ti.f32, (max(restarts, 1), record.RESTART_COLUMNS)),
            features,
        )
        next_row, next_segment = upload(offsets), upload(first_segments)
        for each in recorded:
            if each.is_segment and each.group == 0:
                record.append_segments(
                    each.paths, each.count, each.rays, each.light, each.restart, next_row, next_segment,
                    block.rays, block.light, block.restart,
                )  # fmt: skip
            else:
                record.append_shadow_rays(
                    each.paths, each.count, each.rays, each.light, next_row, each.group, block.rays, block.light
                )
        record.average_paths(
            self.pixels, first, count, self.spp, len(self._scenes),
            block.offsets, block.rays, block.light, features, self.mean,
        )  # fmt: skip
        return block


class _StepRecords:
    """Records of one step under the lights of one group: i32 paths, rays, light and, of segments, restart states."""

    def __init__(self, count: int, group: int, is_segment: bool = False) -> None:
        self.count, self.group, self.is_segment = count, group, is_segment
        room = -(-count // _STEP) * _STEP
        self.paths = device_array(ti.i32, (room,))
        self.rays = device_array(ray, room)
        self.light = device_array(ti.f32, (room, 3))
        self.restart = device_array(ti.f32, (room, record.RESTART_COLUMNS)) if is_segment else None
