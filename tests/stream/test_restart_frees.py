# SPDX-License-Identifier: Apache-2.0
"""A restart frees the arrays of the scenario before at once, without the cyclic collector."""

import gc
import weakref

import tiscene as ts

BUFFERS = {"width": 16, "height": 12, "buffers": ("instance", "depth")}


def scenario(number: int) -> ts.Scenario:
    """Return a scenario whose object bounces off the stage, so that its trees serve collisions."""
    bounce = ts.UniformMovementRandomBounce(speed=1.0, start_direction=(0, -1, 0), seed=number)
    return ts.Scenario("solid_benchmark", [ts.Object("ball", "Ball 01", (0.0, 1.5, 0.0), dynamic=bounce)])


def test_restart_frees_the_arrays_of_the_scenario_before_without_the_collector():
    with ts.Stream(scenario(0), **BUFFERS) as stream:
        collects = gc.isenabled()
        gc.collect()
        gc.disable()
        try:
            for number in range(1, 4):
                assert stream[3]["instance"].shape == (12, 16)
                assert stream.world.trajectories.stepped is not None
                old = [stream._renderer._scene, stream._renderer._scene.trees.bvh, stream.world.trajectories.stepped]
                references = [weakref.ref(each) for each in old]
                del old
                stream.restart(scenario(number))
                assert [each() for each in references] == [None] * 3
        finally:
            if collects:
                gc.enable()


def test_frames_that_are_kept_do_not_keep_the_scenes_on_the_device():
    """They are measured all the same; of the scenes that are made again for it, one is kept at a time."""
    kept, scenes, seen = [], [], []
    with ts.Stream(scenario(0), **BUFFERS) as stream:
        for number in range(1, 4):
            seen.append(stream[3].objects.arrays())
            kept.append(stream[3])
            scenes.append(weakref.ref(stream._renderer._scene))
            stream.restart(scenario(number))
    gc.collect()
    assert [each() for each in scenes] == [None] * 3
    for frame, arrays in zip(kept, seen, strict=True):
        again = frame.objects.arrays()
        assert all(again[name].tobytes() == array.tobytes() for name, array in arrays.items())
    measurers = [frame.objects._measures._measurer for frame in kept]
    assert [each._instruments is not None for each in measurers] == [False, False, True]
