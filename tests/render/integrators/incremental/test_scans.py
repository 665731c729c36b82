# SPDX-License-Identifier: Apache-2.0
"""Lists of incremental frames: the scan for GPUs, in blocks, gives what one thread gives, in the order of the paths."""

import numpy as np
import pytest

from tiscene.device.kernel_types import float8
from tiscene.device.memory import device_array, upload, upload_vectors
from tiscene.render.integrators.incremental import retrace_kernels as kernels
from tiscene.render.integrators.incremental.mover_culling import cull_rays
from tiscene.render.integrators.incremental.path_recording import RESTART_COLUMNS, SEGMENT
from tiscene.render.integrators.path.path_state import PathState, chunks_for

COUNTS = (1, 7, 1000, 40_000, 300_000)
both_scans = pytest.mark.parametrize("in_blocks", [False, True])


def zeros(*shape: int) -> np.ndarray:
    return upload(np.zeros(shape, np.int32))


@both_scans
def test_rays_near_movers_are_listed_in_order(in_blocks: bool) -> None:
    random = np.random.default_rng(1)
    boxes = device_array(float8, 6)
    corners = np.repeat([[-1.0], [-1.0], [-1.0], [1.0], [1.0], [1.0]], 8, axis=1).astype(np.float32)
    boxes.from_numpy(corners)
    for count in COUNTS:
        values = np.zeros((count, 8), np.float32)
        values[:, 0], values[:, 2], values[:, 6], values[:, 7] = random.uniform(-3.0, 3.0, count), -5.0, 1.0, np.inf
        near, candidates = zeros(count), zeros(count)
        chunks = upload(np.full(chunks_for(count), 7, np.int32))
        found = cull_rays(upload_vectors(values), count, boxes, near, candidates, chunks, in_blocks)
        expected = np.flatnonzero(np.abs(values[:, 0]) <= 1.0)
        assert found == len(expected)
        np.testing.assert_array_equal(candidates.to_numpy()[:found], expected)
        np.testing.assert_array_equal(np.flatnonzero(near.to_numpy()), expected)


@both_scans
def test_blocked_shadow_rays_are_listed_in_order(in_blocks: bool) -> None:
    random = np.random.default_rng(2)
    for count in COUNTS:
        values = np.zeros((count, 8), np.float32)
        values[:, SEGMENT] = random.integers(-1, 2, count)
        blocked, candidates = random.integers(0, 2, count), random.permutation(count)
        rows = zeros(count)
        chunks = upload(np.full(chunks_for(count), 7, np.int32))
        found = kernels.select_blocked_shadow_rays(
            upload(candidates), count, upload_vectors(values), upload(blocked), rows, chunks, in_blocks
        )
        expected = candidates[(blocked[candidates] > 0) & (values[candidates, SEGMENT] < 0.0)]
        assert found == len(expected)
        np.testing.assert_array_equal(rows.to_numpy()[:found], expected)


@both_scans
def test_invalidated_paths_are_queued_by_step_and_strided_chunks(in_blocks: bool) -> None:
    random = np.random.default_rng(3)
    steps = 4
    for count in (1, 7, 1000, 40_000):
        # Each path has `steps` segments and no shadow rays; the first blocked one restarts it.
        values = np.zeros((count * steps, 8), np.float32)
        values[:, SEGMENT] = np.arange(count * steps)
        blocked = (random.random((count, steps)) < 0.2).astype(np.int32)
        state = PathState(max(count, 128))
        queue, offsets = zeros(count), np.zeros(steps + 1, np.int32)
        chunks = upload(np.full(chunks_for(count) * steps, 7, np.int32))
        invalidated = zeros(count, 2)
        kernels.find_invalidated(
            count, steps, upload(np.arange(count + 1) * steps), upload_vectors(values),
            upload(np.zeros((count * steps, 3), np.float32)), np.ones((1, 3), np.float32),
            upload(np.zeros((count * steps, RESTART_COLUMNS), np.float32)), upload(blocked.ravel()),
            state.rays, state.state, state.features, state.status, upload(np.zeros((count, 3), np.float32)),
            invalidated, chunks, queue, offsets, in_blocks,
        )  # fmt: skip
        first = np.where(blocked.any(axis=1), blocked.argmax(axis=1), -1)
        np.testing.assert_array_equal(invalidated.to_numpy()[:, 1], first)
        size = min(max(count // 1024, 8), 128)
        chunk = np.arange(count) // size
        order = np.lexsort((np.arange(count), chunk // kernels.STRIDES, chunk % kernels.STRIDES, first))
        expected = order[first[order] >= 0]
        np.testing.assert_array_equal(queue.to_numpy()[: len(expected)], expected)
        np.testing.assert_array_equal(offsets, np.searchsorted(first[expected], np.arange(steps + 1)))
