# SPDX-License-Identifier: Apache-2.0
"""The shutter: what moves while it is open is blurred, by its own path, and nothing else of a frame changes."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import preview_material, write
from tests.world.test_collisions import EMPTY, STAGE, bouncer, path, world
from tiscene.errors import ArgumentError, StageWarning
from tiscene.render.integrators.incremental.incremental_pass import IncrementalPass
from tiscene.render.view import View
from tiscene.stream.shutter import MAX_TIMES, shutter_samples
from tiscene.usd.read.stage_reader import read_stage

# A square of 2 m that glows before a camera that sees 10 m of its plane from below to above: 5 px a meter.
SQUARE = """
def Camera "Camera" {
    float verticalAperture = 20
    float focalLength = 10
    float exposure = 0
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
class "Templates" {
    def Xform "Square" {
        def Mesh "Face" (prepend apiSchemas = ["MaterialBindingAPI"]) {
            point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
            int[] faceVertexCounts = [4]
            int[] faceVertexIndices = [0, 1, 2, 3]
            rel material:binding = </Glow>
        }
    }
}
"""
SQUARE += preview_material(
    "/Glow", "color3f inputs:emissiveColor = (4, 4, 4)", "color3f inputs:diffuseColor = (0, 0, 0)"
)
WIDTH, HEIGHT, FRAME = 100, 50, 5
SPEED = 10.0  # px a frame
CROSSING = ts.Keyframes(
    (0.0, 10.0), [ts.Waypoint((-10.0, 0, 0)), ts.Waypoint((490.0, 0, 0))]
)  # in the middle at frame 5
SETTINGS = {"width": WIDTH, "height": HEIGHT, "fps": 25, "frames": 10, "spp": 64, "denoise": False, "max_depth": 2}


@pytest.fixture
def square(tmp_path):
    return str(write(tmp_path, SQUARE))


def crossing(scene: str) -> ts.Scenario:
    return ts.Scenario(scene, [ts.Object("q", "Square", dynamic=CROSSING, collide=False)])


def covered(opens: float, closes: float) -> np.ndarray:
    """Of every column, the part of the time in which the square of 10 px covers it."""
    x = np.arange(WIDTH) - 0.5 * (WIDTH - 1)
    # The time at which an edge passes a point of the column, over the column's width.
    points = x[:, None] + np.linspace(-0.5, 0.5, 101)
    enters, leaves = (points - 5.0) / SPEED, (points + 5.0) / SPEED
    inside = np.clip(leaves, opens, closes) - np.clip(enters, opens, closes)
    return inside.mean(axis=1) / (closes - opens)


@pytest.mark.parametrize(
    "shutter",
    [(0.0, 0.5), (-0.25, 0.25), *(pytest.param(each, marks=pytest.mark.slow) for each in ((0.0, 1.0), (-1.0, -0.5)))],
)
def test_the_blur_is_as_wide_and_as_bright_as_it_should_be(square, shutter):
    stream = ts.Stream(crossing(square), buffers=("hdr", "depth", "instance"), shutter=shutter, **SETTINGS)
    sharp = ts.Stream(crossing(square), buffers=("hdr", "depth", "instance"), **SETTINGS)[FRAME]
    blurred = stream[FRAME]
    rows = blurred.hdr[20:30, :, 0]
    np.testing.assert_allclose(rows.mean(axis=0), 4.0 * covered(*shutter), atol=0.06)
    assert rows.sum() == pytest.approx(sharp.hdr[20:30, :, 0].sum(), rel=0.01)
    assert np.flatnonzero(rows.any(axis=0)).size >= 14
    for name in ("depth", "instance"):
        assert blurred.buffers[name].tobytes() == sharp.buffers[name].tobytes(), "labels are of the frame's time"
    assert stream[3].hdr.tobytes() != stream[FRAME].hdr.tobytes() == blurred.hdr.tobytes()


def test_the_camera_says_when_its_shutter_opens(tmp_path):
    camera = "float exposure = 0\n    double shutter:open = -0.25\n    double shutter:close = 0.25"
    scene = str(write(tmp_path, SQUARE.replace("float exposure = 0", camera)))
    settings = SETTINGS | {"buffers": ("hdr",), "spp": 4}
    own = ts.Stream(crossing(scene), **settings)
    assert (own.world.camera.shutter_open, own.world.camera.shutter_close) == (-0.25, 0.25)
    given = ts.Stream(crossing(scene), shutter=(-0.25, 0.25), **settings)
    closed = ts.Stream(crossing(scene), shutter=(0, 0), **settings)
    assert own[FRAME].hdr.tobytes() == given[FRAME].hdr.tobytes() != closed[FRAME].hdr.tobytes()
    assert own.settings() != given.settings() != closed.settings()
    ts.Scenario(scene, camera=ts.Camera(shutter_close=0.5)).save(tmp_path / "run.usda")
    assert ts.Scenario.load(tmp_path / "run.usda").camera.shutter_close == 0.5


def test_a_shutter_that_is_open_for_too_long_is_not_used(tmp_path):
    text = SQUARE.replace("float exposure = 0", "double shutter:close = 2")
    with pytest.warns(StageWarning, match="shutter from 0 to 2 frames"):
        assert read_stage(write(tmp_path, text)).cameras[0].shutter_close == 0.0


@pytest.mark.parametrize("shutter", [(0.5, 0.0), (0, 2), 0.5, "ab", (0, float("nan"))])
def test_shutters_that_cannot_be(square, shutter):
    with pytest.raises(ArgumentError, match="shutter="):
        ts.Stream(square, shutter=shutter, frames=1)


def test_where_nothing_moves_nothing_changes(square):
    still = ts.Scenario(square, [ts.Object("q", "Square")])
    a, b = (
        ts.Stream(still, buffers=("hdr",), shutter=shutter, **SETTINGS | {"spp": 4})[2].hdr
        for shutter in (None, (0, 1))
    )
    assert a.tobytes() == b.tobytes()


@pytest.mark.parametrize("color", ["emissiveColor", "diffuseColor"])
def test_animated_materials_are_blurred_though_nothing_moves(tmp_path, color):
    """Emission is a light; a diffuse color is lit by a sun that white reflects with a radiance of 1."""
    dark = ("color3f inputs:diffuseColor = (0, 0, 0)", "float inputs:ior = 1")
    varying = f"color3f inputs:{color}.timeSamples = {{0: (0, 0, 0), 1: (1, 1, 1)}}"
    glow = preview_material("/Glow", *(each for each in dark if color not in each), varying)
    sun = f'def DistantLight "Sun"\n{{\n    float inputs:angle = 0\n    float inputs:intensity = {np.pi}\n}}\n'
    square = SQUARE.replace('class "Templates"', 'def Scope "Still"').partition("def Material")[0]
    text = square + glow + (sun if color == "diffuseColor" else "")
    scene = write(tmp_path, text, more="timeCodesPerSecond = 25\n    startTimeCode = 0\n    endTimeCode = 1")
    hdr = ts.Stream(str(scene), buffers=("hdr",), shutter=(0, 1), **SETTINGS)[0].hdr
    np.testing.assert_allclose(hdr[22:28, 47:53], 0.5, atol=0.01)


def test_frames_with_an_open_shutter_are_no_differences(square, monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a base image is made")

    monkeypatch.setattr(IncrementalPass, "prepare", refuse)
    settings = SETTINGS | {"buffers": ("hdr",), "spp": 2}
    assert ts.Stream(crossing(square), incremental=True, shutter=(0, 0.5), **settings)[1].hdr.any()


def test_moments_are_spread_over_the_time_and_a_function_of_the_frame():
    made = world(ts.Object("f", "Cube", dynamic=path((-1, 0, 0), (1, 0, 0))), stage=EMPTY)
    seen = [list(taken(made, index, spp)) for index, spp in ((5, 8), (5, 8), (6, 8), (5, 200))]
    x = [[moment.placement.world_from_object[1, 0, 0, 3] for moment in each] for each in seen]
    assert x[0] == x[1] != x[2]
    others = [moment.placement.world_from_object[1, 0, 0, 3] for moment in taken(made, 5, 8, seed=4)]
    assert others != x[0]
    assert [moment.spp for moment in seen[0]] == [1] * 8
    assert len(seen[3]) == MAX_TIMES
    assert sum(moment.spp for moment in seen[3]) == 200
    # One in each eighth of half a frame, which is 1 cm a frame on this path.
    step = 2.0 / (2.0 * 25)
    parts = (np.array(x[0]) - made.state(5).placement.world_from_object[1, 0, 0, 3]) / (0.5 * step) * 8
    assert (parts.astype(int) == np.arange(8)).all()


def taken(made, index, spp, seed=3):
    state = made.state(index)
    return shutter_samples(made, state, View(*state.cameras[0], 8, 6), (0.0, 0.5), spp=spp, seed=seed)


def test_camera_turns_the_shorter_way_whatever_the_sign_of_its_quaternion():
    """By 40 degrees, to a quaternion that is the negative of the near one."""
    made, half = world(stage=EMPTY), np.radians(20.0)
    start, end = ts.Camera(), ts.Camera(rotation=(-np.cos(half), 0, -np.sin(half), 0))
    view = View(start, start, end, 8, 6)
    samples = list(shutter_samples(made, made.state(5), view, (0.0, 1.0), spp=8, seed=3))
    turned = [2.0 * np.degrees(np.arctan2(q[2], q[0])) for q in (sample.view.current.rotation for sample in samples)]
    assert turned == sorted(turned)
    assert 0.0 < turned[0] < 10.0
    assert 30.0 < turned[-1] < 40.0


def test_formulas_are_exact_and_collisions_go_straight():
    shift = Fraction(3, 8)
    loop = path((-1, 0, 0), (1, 0, 0), (0, 1, 0), time=3.0)
    free = world(ts.Object("f", "Cube", dynamic=loop), stage=EMPTY)
    # The same path beside something that bounces: it is stepped, but keeps to its formula.
    beside = world(ts.Object("f", "Cube", (0, 0, 0), dynamic=loop), bouncer("b", position=(-2, -1, -2)), stage=STAGE)
    for frame in (0, 7, 31):
        exact = free.trajectories.between(frame, shift, (0,))[0]
        assert exact.tobytes() == free.trajectories.closed_form.poses(Fraction(8 * frame + 3, 8 * 25))[0].tobytes()
        assert beside.trajectories.between(frame, shift, (0, 1))[0].tobytes() == exact.tobytes()
        before, now, after = (beside.trajectories.poses(k, (0, 1))[1] for k in (frame - 1, frame, frame + 1))
        np.testing.assert_allclose(
            beside.trajectories.between(frame, shift, (0, 1))[1, :3], now[:3] + 0.375 * (after - now)[:3], atol=1e-12
        )
        np.testing.assert_allclose(
            beside.trajectories.between(frame, -shift, (0, 1))[1, :3], now[:3] + 0.375 * (before - now)[:3], atol=1e-12
        )


def test_a_camera_keeps_to_its_path():
    around = ts.Camera((0, 1, 3), name="Around", dynamic=ts.LookAt((0, 0, 0), ts.Orbit((0, 1, 0), period=1.0)))
    made = world(camera=around, stage=EMPTY)
    for shift in (Fraction(1, 2), Fraction(-1, 4)):
        angle = 2.0 * np.pi * float(3 + shift) / 25
        place = made.between(3, shift)[1][0].position
        np.testing.assert_allclose(place, (3 * np.sin(angle), 1.0, 3 * np.cos(angle)), atol=1e-9)


def test_edit_of_the_next_frame_is_not_anticipated_when_the_shutter_closes_with_it():
    """Times between 0.999 and 1 frames are rounded to 1."""
    made = world(bouncer("b", position=(-2, -1, -2)), ts.Object("c", "Cube", (0, 0, 2)), stage=STAGE)
    before = made.between(7, Fraction(1))[0].world_from_object.tobytes()
    made.next_frame = 8
    made.move("b", (1, 1, 1), (0, 45, 0))
    made.move("c", (-1, 1, 1))
    assert made.between(7, Fraction(1))[0].world_from_object.tobytes() == before
