# SPDX-License-Identifier: Apache-2.0
"""Several frames rendered at once have the bytes of frames rendered one by one."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.stream.test_stream import moving_scenario
from tiscene.errors import ArgumentError
from tiscene.frame.buffers import LABELS
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.path.path_frames import PathFrames
from tiscene.scene.device_scene import DeviceScene
from tiscene.scene.lights.light_groups import emission_of, with_emission
from tiscene.stream import frame_batches

SIZE = {"width": 32, "height": 24}
SURFACES = tuple(name for name in LABELS if "coverage" not in name)


def frames_of_calls(monkeypatch: pytest.MonkeyPatch, kind: type) -> list[int]:
    """Return a list that receives the number of frames of each `render_frames` of a class; 0 where it cannot."""
    found: list[int] = []
    render = kind.render_frames

    def counted(self, *args, **options):
        result = render(self, *args, **options)
        found.append(len(result or ()))
        return result

    monkeypatch.setattr(kind, "render_frames", counted)
    return found


@pytest.fixture
def rendered(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Receives the number of frames of each call that renders labels of several."""
    return frames_of_calls(monkeypatch, LabelPass)


@pytest.fixture
def traced(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Receives the number of frames of each call that traces the light of several."""
    return frames_of_calls(monkeypatch, PathFrames)


def orbiting() -> ts.Scenario:
    """Return moving objects, one of which spawns and one despawns, before a moving camera."""
    scenario = moving_scenario()
    places = [(0.6 * np.cos(a), 0.3, 2.0 + 0.5 * np.sin(a)) for a in (0.0, 2.0, 4.0)]
    path = ts.LinearWaypoints([ts.Waypoint(place, (0, 10 * k, 0)) for k, place in enumerate(places)], total_time=1.0)
    return replace(scenario, camera=replace(scenario.camera, dynamic=path))


def assert_equal(one: ts.Frame, other: ts.Frame) -> None:
    assert one.index == other.index
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=f"{one.index}: {name}")
    for mine, theirs in zip(one.objects, other.objects, strict=True):
        assert mine.id == theirs.id
        assert mine.visible_pixels == theirs.visible_pixels


@pytest.mark.parametrize("scenario", [moving_scenario, orbiting])
def test_slices_and_iteration_have_the_bytes_of_single_frames(scenario, rendered: list[int]) -> None:
    with (
        ts.Stream(scenario(), **SIZE, buffers=SURFACES, frames=10) as single,
        ts.Stream(scenario(), **SIZE, buffers=SURFACES, frames=10, batch=4) as batched,
    ):
        expected = list(single)
        assert not rendered
        for one, other in zip(batched[0:10], expected, strict=True):
            assert_equal(one, other)
        assert rendered == [4, 4, 2]
        for one, other in zip(batched, expected, strict=True):
            assert_equal(one, other)
        assert rendered == [4, 4, 2] * 2
        for one, other in zip(batched[8:1:-3], expected[8:1:-3], strict=True):
            assert_equal(one, other)
        assert_equal(batched[5], expected[5])
        assert rendered == [4, 4, 2] * 2 + [3]


def test_layout_of_gpus_renders_the_same_bytes(monkeypatch: pytest.MonkeyPatch, rendered: list[int]) -> None:
    with ts.Stream(orbiting(), **SIZE, buffers=SURFACES, frames=4) as single:
        expected = list(single)
    made = DeviceScene.__init__
    monkeypatch.setattr(DeviceScene, "__init__", lambda self, *_, **options: made(self, "bvh2", **options))
    with ts.Stream(orbiting(), **SIZE, buffers=SURFACES, frames=4, batch=4) as batched:
        for one, other in zip(batched, expected, strict=True):
            assert_equal(one, other)
    assert rendered == [4]


def test_another_stream_does_not_take_frames_that_this_one_has_rendered() -> None:
    options = {**SIZE, "buffers": ("instance",), "frames": 4, "batch": 4}
    with ts.Stream(orbiting(), **options) as one, ts.Stream(orbiting(), **options) as expected:
        assert_equal(next(one), next(expected))
        with one.another(moving_scenario()) as other:
            next(other)
            assert_equal(next(one), next(expected))


def emissive() -> ts.Scenario:
    """Return the objects of `orbiting` beside a lamp, a mesh that emits light."""
    return replace(orbiting(), objects=(*orbiting().objects, ts.Object("lamp", "Lamp Floor 01", (0.0, -0.5, -1.0))))


COLORED = {**SIZE, "buffers": ("rgb", "hdr", "depth", "instance"), "spp": 2, "max_depth": 3, "frames": 5}


def test_frames_of_a_batch_show_a_light_that_is_replaced_between_them(traced: list[int]) -> None:
    """Of a scene with a material that emits light, which needs the same shading kernel as the test below."""
    with ts.Stream(emissive(), **COLORED, incremental=False, denoise=False, batch=3) as stream:
        next(stream)
        light = stream.world.stage.lights[0]
        stream.world.set_light(0, with_emission(light, tuple(0.2 * each for each in emission_of(light))))
        before, shown = stream.another(emissive())[1].rgb, next(stream).rgb
        assert shown.tobytes() == stream[1].rgb.tobytes() != before.tobytes()
    assert 3 in traced


def assert_batches_equal(scenario: ts.Scenario, **options: object) -> None:
    options = COLORED | options
    with ts.Stream(scenario, **options) as single, ts.Stream(scenario, **options, batch=3) as batched:
        expected = list(single)
        for one, other in zip(batched, expected, strict=True):
            assert_equal(one, other)
            assert one.spp == other.spp > 0
        for one, other in zip(batched[1:3], expected[1:3], strict=True):
            assert_equal(one, other)


@pytest.mark.parametrize("options", [{"denoise": False}, {"quality": "fast"}], ids=["raw", "downscaled"])
def test_colors_of_path_traced_frames_are_traced_at_once(
    options: dict[str, object], rendered: list[int], traced: list[int]
) -> None:
    assert_batches_equal(emissive(), incremental=False, **options)
    assert rendered == traced == [3, 2, 2]


def test_incremental_frames_are_rendered_beside_batches(rendered: list[int], traced: list[int]) -> None:
    assert_batches_equal(moving_scenario(), incremental=True, denoise=False)
    assert rendered == [3, 2, 2]
    assert not traced


def test_open_shutters_and_adaptive_sampling_are_rendered_frame_by_frame(
    rendered: list[int], traced: list[int]
) -> None:
    for options in ({"shutter": (0.0, 0.5)}, {"relative_error": 0.3}):
        assert_batches_equal(orbiting(), incremental=False, denoise=False, **options)
    assert rendered == [3, 2, 2] * 2
    assert not traced


def test_edit_drops_what_was_rendered_in_vain(rendered: list[int]) -> None:
    options = {**SIZE, "buffers": ("instance", "depth"), "frames": 8}
    frames = []
    for batch in (1, 4):
        with ts.Stream(moving_scenario(), **options, batch=batch) as stream:
            found = []
            for frame in stream:
                found.append(frame)
                if frame.index == 1:
                    stream.world.despawn("cube")
            frames.append(found)
    for one, other in zip(*frames, strict=True):
        assert_equal(one, other)
    assert (frames[0][3].instance != frames[0][1].instance).any()
    assert rendered == [4, 4, 2]


def test_coverage_is_rendered_frame_by_frame(rendered: list[int]) -> None:
    options = {**SIZE, "buffers": ("instance", "coverage"), "frames": 2}
    with ts.Stream(moving_scenario(), **options) as single, ts.Stream(moving_scenario(), **options, batch=2) as batched:
        for one, other in zip(batched, single, strict=True):
            assert_equal(one, other)
    assert rendered == [0]


def test_several_cameras_have_batches_each(rendered: list[int]) -> None:
    cameras = [ts.Camera(name=name, position=(x, 0.5, 2.5)) for name, x in (("left", 0.0), ("right", 0.4))]
    options = {**SIZE, "buffers": ("instance", "depth"), "frames": 3, "camera": cameras}
    with ts.Stream(moving_scenario(), **options) as single, ts.Stream(moving_scenario(), **options, batch=3) as batched:
        for one, other in zip(batched, single, strict=True):
            for mine, theirs in zip(one.views.values(), other.views.values(), strict=True):
                assert_equal(mine, theirs)
    assert rendered == [3, 3]


def test_batches_are_limited_in_pixels(monkeypatch: pytest.MonkeyPatch, rendered: list[int]) -> None:
    monkeypatch.setattr(frame_batches, "MAX_PIXELS", 2 * 32 * 24 + 5)
    with ts.Stream(moving_scenario(), **SIZE, buffers=("depth",), frames=5, batch=100) as stream:
        assert [frame.index for frame in stream] == [0, 1, 2, 3, 4]
    assert rendered == [2, 2, 0]


def test_copy_of_a_stream_renders_by_itself(rendered: list[int]) -> None:
    with ts.Stream(moving_scenario(), **SIZE, buffers=("depth",), frames=4, batch=4) as stream:
        next(stream)
        with pickle.loads(pickle.dumps(stream)) as copy:
            assert_equal(next(copy), next(stream))
    assert rendered == [4, 3]


def test_batch_must_be_positive() -> None:
    with pytest.raises(ArgumentError, match="batch=0"):
        ts.Stream("object_view", batch=0)
