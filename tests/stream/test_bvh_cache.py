# SPDX-License-Identifier: Apache-2.0
"""Coming back to a scene by `restart`: its trees are not built again, and its frames are those of a new stream."""

import gc
import pickle
import weakref

import pytest

from tiscene import LinearWaypoints, MaterialOverride, Object, Scenario, Stream, UniformMovementRandomBounce, Waypoint
from tiscene.device import array_pool, part_arrays
from tiscene.errors import MaterialNotFound
from tiscene.scene.bvh.bvh import Bvh

BUFFERS = ("hdr", "depth", "instance", "forward_flow")
SETTINGS = {"width": 32, "height": 24, "buffers": BUFFERS, "spp": 1, "max_depth": 2}
SCENES = "solid_benchmark", "object_view"


def scenario(scene, *templates):
    """Return objects on paths, and one that bounces off the scene."""
    path = LinearWaypoints([Waypoint((0, 1, -3)), Waypoint((1, 1, -3))], total_time=0.2)
    bounce = UniformMovementRandomBounce(speed=2.0)
    objects = [Object(f"o{row}", name, (0, 1, -3), dynamic=path) for row, name in enumerate(templates)]
    return Scenario(scene, [*objects, Object("b", "Ball 01", (0, 1, -2), dynamic=bounce)])


def rendered(stream):
    return [frame[name].tobytes() for frame in (stream[0], stream[2]) for name in stream.buffers]


@pytest.fixture
def built(monkeypatch):
    """Return the numbers of meshes whose trees are built while the test runs."""
    counts, build = [], Bvh.add_meshes

    def counted(self, positions, triangles, first_triangle):
        counts.append(len(triangles))
        return build(self, positions, triangles, first_triangle)

    monkeypatch.setattr(Bvh, "add_meshes", counted)
    return counts


def test_scene_that_is_come_back_to_has_the_bytes_of_a_new_stream_and_builds_nothing(built):
    visits = [scenario(scene, *templates) for templates in (("Cube",), ("Chair 01", "Cube")) for scene in SCENES]
    fresh = []
    for each in visits:
        with Stream(each, **SETTINGS) as stream:
            fresh.append(rendered(stream))
    stages = {each.scene: len(stream.stages.stage(each).meshes) for each in visits}
    stream = Stream(visits[0], **SETTINGS)
    assert rendered(stream) == fresh[0]
    for each, expected in zip(visits[1:] + visits[:1], fresh[1:] + fresh[:1], strict=True):
        known, before = stream.stages.trees.get(stream.stages.stage(each)), len(built)
        stream.restart(each)
        assert rendered(stream) == expected
        # The templates' trees were built for the new streams.
        assert built[before:] == ([] if known is not None else [stages[each.scene]])
    assert stream.stages.trees.nbytes > 0
    stream.close()
    assert stream.stages.trees.nbytes == 0


def test_same_scene_again_builds_nothing_even_with_other_materials(built):
    stream = Stream("solid_benchmark", **SETTINGS)
    first = rendered(stream)
    painted = MaterialOverride(stream.world.stage.materials[0].prim_path, color=(1.0, 0.0, 0.0))
    built.clear()
    stream.restart(Scenario("solid_benchmark", overrides=[painted]))
    assert rendered(stream)[1:3] == first[1:3]
    stream.restart(Scenario.load("solid_benchmark"))
    assert rendered(stream) == first
    assert built == []


def test_trees_beyond_the_limit_are_dropped_those_used_least_recently_first(built):
    stream = Stream(Scenario(SCENES[0]), **SETTINGS)
    trees = stream.stages.trees
    stages = [stream.stages.stage(Scenario(scene)) for scene in SCENES]
    for scene in (SCENES[1], SCENES[0]):
        stream[0]
        stream.restart(Scenario(scene))
    used = trees.nbytes
    assert all(trees.get(stage) is not None for stage in stages)
    trees.limit = used - 1
    stream[0]
    stream.restart(Scenario(SCENES[1]))
    assert [trees.get(stage) is not None for stage in stages] == [True, False]
    assert 0 < trees.nbytes < used


def test_failed_restart_keeps_the_world_and_its_frames():
    stream = Stream(scenario(SCENES[0], "Cube"), **SETTINGS)
    before = rendered(stream)
    with pytest.raises(MaterialNotFound):
        stream.restart(Scenario(SCENES[0], overrides=[MaterialOverride("/Nothing", color=(1.0, 0.0, 0.0))]))
    assert rendered(stream) == before


def test_trees_are_not_pickled():
    stream = Stream(Scenario(SCENES[0]), **SETTINGS)
    stream[0]
    stream.restart(Scenario(SCENES[1]))
    assert stream.stages.trees.nbytes > 0
    assert pickle.loads(pickle.dumps(stream.stages.trees)).nbytes == 0


def test_frame_is_measured_when_other_scenarios_of_its_scene_have_been_rendered():
    first, second = (scenario("solid_benchmark", *names) for names in (("Chair 01",), ("Cube", "Book 01")))
    with Stream(first, **SETTINGS) as stream:
        expected = [row.amodal_pixels for row in stream[2].objects]
    with Stream(first, **SETTINGS) as stream:
        stream[0]
        for each in (second, first):
            stream.restart(each)
            frame = stream[2]
        for each in (second, second):
            stream.restart(each)
            rendered(stream)
        assert [row.amodal_pixels for row in frame.objects] == expected


def test_meshes_and_images_of_a_scene_that_is_come_back_to_are_not_copied_again(monkeypatch):
    copied, write = [], part_arrays.write_rows
    monkeypatch.setattr(part_arrays, "write_rows", lambda *args: copied.append(len(args[2])) or write(*args))
    with Stream(scenario("solid_benchmark", "Cube"), **SETTINGS) as stream:
        counts = []
        for template in ("Cube", "Chair 01", "Chair 01", "Cube"):
            stream.restart(scenario("solid_benchmark", template))
            copied.clear()
            stream[0]
            counts.append(sum(copied))
    assert counts[2] == 0  # all is there
    assert 0 < counts[3] < counts[0] / 3  # the stage is there


def test_arrays_of_a_stream_that_is_dropped_unclosed_serve_the_next_one(monkeypatch):
    # The stream's world is a cycle of references, which the collector deletes at once, arrays included.
    monkeypatch.setattr(array_pool, "MAX_ARRAY", 0)  # as if they were too large to be kept once deleted
    visited = scenario("solid_benchmark", "Cube")
    stream = Stream(visited, **SETTINGS)
    expected, stages = rendered(stream), stream.stages
    stream.restart(visited)
    stream[0]
    dropped = weakref.ref(stream.world)
    del vars(stream)["world"], vars(stream)["_renderer"]
    gc.collect()
    assert dropped() is None
    assert stages.trees.get(stages.stage(visited)).arrays is not None
    stream.restart(visited)
    assert rendered(stream) == expected
