# SPDX-License-Identifier: Apache-2.0
"""Compaction of queues: the scan for GPUs, in blocks, gives what one thread gives."""

import numpy as np
import pytest

from tiscene.device.memory import upload
from tiscene.render.integrators.path.path_state import LIGHT_PENDING, LIVE, chunks_for
from tiscene.render.integrators.path.wavefront_kernels import compact_queue


@pytest.mark.parametrize("in_blocks", [False, True])
def test_compacted_queues_keep_their_order(in_blocks: bool) -> None:
    random = np.random.default_rng(1)
    for count in (1, 7, 1000, 40_000, 300_000):
        status = random.choice([0, LIVE, LIGHT_PENDING, LIVE | LIGHT_PENDING], count)
        queue = random.permutation(count).astype(np.int32)
        live, shadows = upload(np.zeros(count, np.int32)), upload(np.zeros(count, np.int32))
        chunks = [upload(np.full(chunks_for(count), 7, np.int32)) for _ in range(2)]
        found = compact_queue(upload(status), upload(queue), count, live, shadows, *chunks, in_blocks)
        for flag, result, size in ((LIVE, live, found & 0xFFFFFFFF), (LIGHT_PENDING, shadows, found >> 32)):
            expected = queue[status[queue] & flag > 0]
            assert size == len(expected)
            np.testing.assert_array_equal(result.to_numpy()[:size], expected)
