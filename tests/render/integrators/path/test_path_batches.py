# SPDX-License-Identifier: Apache-2.0
"""Large frames are traced in batches: arrays and launches stay bounded, and every path is traced once."""

import numpy as np
import pytest

from tests.render.tracing import mesh, placed, scene_of
from tiscene.render.integrators.path.path_pass import BATCH_SIZE, PathPass
from tiscene.render.integrators.path.path_state import STATE_COLUMNS, PathSamples
from tiscene.render.view import View
from tiscene.scene.camera import Camera

SQUARE = mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]])


def test_full_hd_at_64_samples_is_traced_in_bounded_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    width, height, spp = 1920, 1080, 64
    paths = PathPass(scene_of((SQUARE,), placed([0])), width, height)
    batches = []
    monkeypatch.setattr(paths, "_trace_batch", lambda *args: batches.append((args[2].size, args[3], args[4])))
    camera = Camera(position=(0, 0, 3))
    view = View(camera, camera, camera, width, height)
    paths._trace(view, width * height, PathSamples(spp, 6, 1), 4)
    sizes, firsts, counts = np.array(batches).T
    assert sizes.max() == BATCH_SIZE
    assert (counts <= sizes).all()
    np.testing.assert_array_equal(firsts, np.cumsum(counts) - counts)
    assert counts.sum() == width * height * spp
    assert BATCH_SIZE * STATE_COLUMNS < 2**31  # Taichi's indices are 32 bits
    assert firsts.max() < 2**31
