# SPDX-License-Identifier: Apache-2.0
"""A stream that is restarted with another scene or other variants shows those."""

import gc
from dataclasses import replace

import numpy as np
import pytest
from taichi.lang._ndarray import Ndarray

import tiscene as ts
from tests.stream.test_stream import same
from tiscene.errors import ArgumentError, SceneNotFound


def test_restart_with_another_scene_loads_that_scene():
    settings = {"width": 16, "height": 12, "buffers": ("instance", "semantic")}
    stream = ts.Stream("object_view", **settings)
    before = stream.settings()
    stream.restart(ts.Scenario("solid_benchmark"))
    other = ts.Stream("solid_benchmark", **settings)
    assert same(stream[0], other[0])
    assert stream.categories == other.categories
    assert stream.settings() == other.settings() != before
    stream.restart(ts.Scenario("object_view"))
    assert stream.settings() == before


def test_restart_with_a_missing_scene_or_an_impossible_size_changes_nothing():
    stream = ts.Stream("object_view", width=8, height=6, buffers=("instance",))
    first = stream[0]
    with pytest.raises(SceneNotFound):
        stream.restart(ts.Scenario("nowhere"))
    assert same(stream[0], first)
    for size in ({"width": 0}, {"height": -6}, {"width": 2.5}, {"height": 10**6}):
        with pytest.raises(ArgumentError, match=next(iter(size))):
            stream.restart(stream.scenario, **size)
        assert same(stream[0], first)


def test_restart_changes_variants(tmp_path):
    path = tmp_path / "variants.usda"
    variants = "".join(
        f'        "{name}" {{\n            over "Box"\n            {{\n'
        f"                double size = {size}\n            }}\n        }}\n"
        for name, size in (("small", 1), ("large", 3))
    )
    path.write_text(
        '#usda 1.0\n(\n    metersPerUnit = 1\n    defaultPrim = "Room"\n)\ndef Xform "Room" (\n'
        '    variants = { string size = "small" }\n    prepend variantSets = "size"\n)\n{\n'
        f'    def Cube "Box"\n    {{\n    }}\n    variantSet "size" = {{\n{variants}    }}\n}}\n'
    )
    camera = ts.Camera.look_at((0.0, 0.0, 9.0), (0.0, 0.0, 0.0))
    small = ts.Scenario(str(path), camera=camera)
    large = replace(small, variants={"/Room{size}": "large"})
    stream = ts.Stream(small, width=32, height=24, buffers=("instance",))
    few = np.count_nonzero(stream[0].instance)
    stream.restart(large)
    assert np.count_nonzero(stream[0].instance) > 4 * few
    large.save(tmp_path / "large.json")
    assert ts.Scenario.load(tmp_path / "large.json") == large
    assert same(ts.Stream(tmp_path / "large.json", width=32, height=24, buffers=("instance",))[0], stream[0])


def test_restarts_free_device_memory():
    """Device arrays of earlier scenes are freed at once, without the cyclic garbage collector."""
    stream = ts.Stream("solid_benchmark", width=16, height=12, buffers=("hdr", "instance"), spp=1, quality="fast")
    gc.collect()
    gc.disable()
    try:
        counts = []
        for scene in ("solid_benchmark", "object_view") * 5:
            stream.restart(ts.Scenario(scene))
            stream[0]
            # Not isinstance: objects of other libraries answer it with a deprecation warning.
            counts.append(sum(issubclass(type(each), Ndarray) for each in gc.get_objects()))
    finally:
        gc.enable()
    assert counts[-2:] == counts[4:6]  # both scenes' arrays are kept for their next visit by then
