# SPDX-License-Identifier: Apache-2.0
import gc
import weakref

import numpy as np

from tiscene.frame.buffers import BUFFERS, COLORS, LABELS, RANKS, complete, times_needed
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS


def test_every_buffer_of_the_conventions_is_there() -> None:
    expected = {
        "rgb", "hdr", "denoised", "depth", "distance", "position", "normal", "geometric_normal", "normal_camera",
        "albedo", "roughness", "metallic", "semantic", "instance", "part", "forward_flow", "backward_flow",
        "forward_occlusion", "backward_occlusion", "scene_flow", "uv", "object_coordinates", "coverage",
        "material_coverage",
    }  # fmt: skip
    assert set(BUFFERS) == expected
    assert set(LABELS) | COLORS == expected
    assert all(name == aov.name and aov.doc.endswith(".") for name, aov in BUFFERS.items())


def test_arrays_have_the_shape_and_type_of_the_table() -> None:
    assert BUFFERS["depth"].empty(4, 3).shape == (3, 4)
    assert BUFFERS["forward_flow"].empty(4, 3).shape == (3, 4, 2)
    assert BUFFERS["coverage"].empty(4, 3).shape == (3, 4, RANKS, 2)
    assert {BUFFERS[name].empty(4, 3).dtype for name in ("semantic", "instance", "part")} == {np.dtype(np.int32)}
    assert BUFFERS["backward_occlusion"].empty(4, 3).dtype == np.bool_


def test_only_occlusion_needs_other_times() -> None:
    assert times_needed(()) == (CURRENT,)
    assert times_needed(("rgb", "forward_flow", "scene_flow")) == (CURRENT,)
    assert times_needed(("forward_occlusion",)) == (CURRENT, NEXT)
    assert times_needed(("backward_occlusion", "forward_occlusion")) == (PREVIOUS, CURRENT, NEXT)


def test_arrays_of_a_frame_are_freed_with_it_without_garbage_collection() -> None:
    array = np.zeros((3, 4), np.float32)
    alive = weakref.ref(array)
    gc.disable()
    try:
        buffers = complete(("depth",), {"depth": array})
        assert buffers["depth"] is array
        del array, buffers
        assert alive() is None
    finally:
        gc.enable()
