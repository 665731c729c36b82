# SPDX-License-Identifier: Apache-2.0
"""Frames of a stream from elsewhere: `Stream.render_view`."""

import pytest

import tiscene as ts
from tiscene.errors import ArgumentError, ArgumentTypeError, CameraNotFound

SCENARIO = ts.Scenario("object_view", [ts.Object("ball", "Ball 01", (0, 1, -3))])
SETTINGS = {"width": 16, "height": 12, "quality": "fast", "buffers": ("rgb", "depth")}


def test_incremental_overrides_the_setting_of_the_stream():
    shared, traced = (ts.Stream(SCENARIO, incremental=each, **SETTINGS) for each in (True, False))
    camera = shared.world.camera
    first, second = shared[2].rgb, traced[2].rgb
    assert (first != second).any()
    for stream in (shared, traced):
        assert (stream.render_view(2, camera, incremental=True).rgb == first).all()
        assert (stream.render_view(2, camera, incremental=False).rgb == second).all()
    assert (shared.render_view(2, camera).rgb == first).all()


def test_camera_of_the_stage_is_named():
    stream = ts.Stream(SCENARIO, **SETTINGS)
    path = next(iter(stream.world.stage.camera_names))
    for name in (stream.world.stage.camera_names[path], path):
        assert (stream.render_view(0, name, ("depth",)).depth == stream[0].depth).all()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((0, "Mian"), CameraNotFound, "Did you mean 'Main'"),
        ((0, None), ArgumentTypeError, "view=None: must be a Camera, the name of one on the stage, or a View"),
        ((-1, ts.Camera()), ArgumentError, "frame=-1: must be at least 0"),
        ((0, ts.Camera(), ("rgb",), "yes"), ArgumentTypeError, "incremental='yes': must be True or False"),
    ],
)
def test_wrong_arguments_are_refused(arguments, error, message):
    index, view, buffers, incremental = (*arguments, None, None)[:4]
    with pytest.raises(error, match=message):
        ts.Stream(SCENARIO, **SETTINGS).render_view(index, view, buffers, incremental=incremental)
