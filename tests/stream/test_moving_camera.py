# SPDX-License-Identifier: Apache-2.0
"""Streams with `incremental="camera"`: what the light cache may change, and what not."""

from __future__ import annotations

import numpy as np
import pytest

import tiscene as ts
from tiscene.errors import ArgumentError

SIZE = {"width": 32, "height": 24}
BUFFERS = ("hdr", "depth", "instance")
PATH = ts.Orbit((0.0, 1.2, -1.0), period=8.0)


@pytest.fixture(scope="module")
def scenario() -> ts.Scenario:
    """A ball that bounces before a camera on an orbit."""
    ball = ts.Object("ball", "Ball 01", (0.0, 1.0, 0.6), dynamic=ts.UniformMovementRandomBounce(speed=1.0, seed=3))
    camera = ts.Camera((0.0, 1.2, 0.5), dynamic=ts.LookAt((0.0, 0.8, -1.5), PATH))
    return ts.Scenario("solid_benchmark", [ball], camera=camera)


def test_frames_of_a_moving_camera_do_not_depend_on_earlier_frames(scenario: ts.Scenario) -> None:
    settings = {"quality": "fast", "incremental": "camera", "buffers": BUFFERS, **SIZE}
    with ts.Stream(scenario, **settings) as stream, ts.Stream(scenario, **settings) as fresh:  # type: ignore[arg-type]
        frames = {index: stream[index] for index in (2, 9)}
        assert frames[9].spp == 4
        for index in (9, 2):
            for name in BUFFERS:
                np.testing.assert_array_equal(fresh[index][name], frames[index][name], err_msg=f"{index}: {name}")
    with ts.Stream(scenario, **settings | {"incremental": True}) as traced:  # type: ignore[arg-type]
        other = traced[9]
    assert other.spp == 1
    for name in ("depth", "instance"):
        np.testing.assert_array_equal(other[name], frames[9][name])
    assert other.hdr.mean() == pytest.approx(frames[9].hdr.mean(), rel=0.1)


def test_light_cache_is_part_of_the_settings_and_off_by_default(scenario: ts.Scenario) -> None:
    found = {}
    for incremental in (None, True, "camera"):
        with ts.Stream(scenario, quality="fast", incremental=incremental, **SIZE) as stream:  # type: ignore[arg-type]
            found[incremental] = stream.settings()["incremental"]
    assert found[None] == found[True]
    assert found["camera"][:3] == found[True]
    assert len(found["camera"]) > 3
    with pytest.raises(ArgumentError, match="incremental='moving'"):
        ts.Stream(scenario, incremental="moving", **SIZE)  # type: ignore[arg-type]
