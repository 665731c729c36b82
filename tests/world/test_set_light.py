# SPDX-License-Identifier: Apache-2.0
"""Lights that `set_light` replaces: checks, copies of the stream, and frames that were rendered before."""

import copy
import pickle
from dataclasses import replace

import pytest

import tiscene as ts
from tiscene.errors import ArgumentError
from tiscene.scene.description import DistantLight

SIZE = {"width": 16, "height": 12}


@pytest.fixture
def stream():
    with ts.Stream("solid_benchmark", buffers=("rgb",), spp=2, denoise=False, **SIZE) as made:
        yield made


def dimmed(stream):
    light = stream.world.stage.lights[0]
    return replace(light, radiance=tuple(0.2 * each for each in light.radiance))


@pytest.mark.parametrize("row", [-1, 99, True, 0.5, "KeyLight"])
def test_a_row_without_a_light_is_refused(stream, row):
    with pytest.raises(ArgumentError, match="row="):
        stream.set_light(row, dimmed(stream))


@pytest.mark.parametrize("light", [None, "dark", DistantLight("sun", "/sun", ts.Camera(), (1.0, 1.0, 1.0), 0.1)])
def test_a_light_of_another_kind_is_refused(stream, light):
    with pytest.raises(ArgumentError, match=r"must be a RectLight, as /"):
        stream.set_light(0, light)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda stream: pickle.loads(pickle.dumps(stream))])
def test_copies_of_a_stream_have_its_lights(stream, copied):
    before = stream[0].rgb.tobytes()
    stream.set_light(0, dimmed(stream))
    with copied(stream) as other:
        assert other[0].rgb.tobytes() == stream[0].rgb.tobytes() != before
        other.load_state_dict(stream.state_dict())


def test_a_state_of_other_lights_is_refused(stream):
    without = stream.state_dict()
    stream.set_light(0, dimmed(stream))
    with_light = stream.state_dict()
    with pytest.raises(ArgumentError, match="Call set_light"):
        stream.load_state_dict(without)
    with (
        ts.Stream("solid_benchmark", buffers=("rgb",), spp=2, denoise=False, **SIZE) as other,
        pytest.raises(ArgumentError, match="Call set_light"),
    ):
        other.load_state_dict(with_light)


def test_a_light_replaced_in_the_world_of_a_stream_that_renders_ahead_is_refused():
    with ts.Stream("solid_benchmark", buffers=("rgb",), spp=2, prefetch=2, **SIZE) as stream:
        stream.world.set_light(0, dimmed(stream))
        with pytest.raises(ArgumentError, match="prefetch=0"):
            next(stream)
