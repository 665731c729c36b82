# SPDX-License-Identifier: Apache-2.0
"""A stream that is restarted with another scene or other variants shows those."""

import gc
from dataclasses import replace

import numpy as np
import pytest
from taichi.lang._ndarray import Ndarray

import tiscene as ts
from tests.stream.test_stream import same
from tests.usd.helpers import write
from tiscene.errors import ArgumentError, SceneNotFound, StageWarning
from tiscene.stream import stage_cache


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
    variants = "".join(
        f'"{name}" {{\n    over "Box" {{\n        double size = {size}\n    }}\n}}\n'
        for name, size in (("small", 1), ("large", 3))
    )
    room = 'def Xform "Room" (\n    variants = { string size = "small" }\n    prepend variantSets = "size"\n) {\n'
    path = write(tmp_path, f'{room}def Cube "Box" {{}}\nvariantSet "size" = {{\n{variants}}}\n}}\n')
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


def write_part(path, size):
    body = f'def Xform "Part" {{\n    def Cube "Box" {{\n        double size = {size}\n    }}\n}}\n'
    write(path.parent, body, name=path.name, more='defaultPrim = "Part"')


@pytest.fixture
def reads(monkeypatch):
    """Return a list of the stages that streams read from now on."""
    read, load = [], stage_cache.load
    monkeypatch.setattr(stage_cache, "load", lambda *given, **named: read.append(given[0]) or load(*given, **named))
    return read


@pytest.fixture
def room_of_part(tmp_path):
    """Return a scenario whose stage refers to part.usda, beside it."""
    far = 'double3 xformOp:translate = (0, 0, 99)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n'
    path = write(tmp_path, f'def "Part" (references = @./part.usda@) {{}}\ndef Cube "Far" {{\n{far}}}\n')
    write_part(tmp_path / "part.usda", 1)
    return ts.Scenario(str(path), camera=ts.Camera.look_at((0.0, 0.0, 9.0), (0.0, 0.0, 0.0)))


SMALL = {"width": 32, "height": 24, "buffers": ("instance",)}


def test_restart_reads_a_stage_again_once_a_layer_that_it_refers_to_has_changed(room_of_part, tmp_path, reads):
    stream = ts.Stream(room_of_part, **SMALL)
    few, state = np.count_nonzero(stream[0].instance), stream.state_dict()
    stream.restart(room_of_part)
    assert len(reads) == 1
    write_part(tmp_path / "part.usda", 3)
    stream.restart(room_of_part)
    assert len(reads) == 2
    assert np.count_nonzero(stream[0].instance) > 4 * few
    with pytest.raises(ArgumentError, match="The files of the scene or of a template have changed"):
        stream.load_state_dict(state)


def test_restart_reads_a_stage_with_a_missing_layer_again_once_it_is_there(room_of_part, tmp_path, reads):
    (tmp_path / "part.usda").unlink()
    with pytest.warns(StageWarning, match="part"):
        stream = ts.Stream(room_of_part, **SMALL)
    stream.restart(room_of_part)
    assert len(reads) == 1
    assert not stream[0].instance.any()
    write_part(tmp_path / "part.usda", 3)
    stream.restart(room_of_part)
    assert stream[0].instance.any()


def test_stage_that_refers_to_a_broken_layer_has_settings(room_of_part, tmp_path):
    (tmp_path / "part.usda").write_text("#usda 1.0\ndef {")
    with pytest.warns(StageWarning, match="part"):
        stream = ts.Stream(room_of_part, **SMALL)
    before = stream.settings()["files"]
    write_part(tmp_path / "part.usda", 1)
    stream.restart(room_of_part)
    assert stream[0].instance.any()
    assert stream.settings()["files"] != before


def test_files_of_an_untrusted_stage_are_not_opened_by_restart(room_of_part, monkeypatch):
    def opened(file):
        raise AssertionError(f"{file} was opened in this process")

    monkeypatch.setattr(stage_cache, "layer_state", opened)
    ts.Stream(room_of_part, **SMALL, untrusted=True).restart(room_of_part)
