# SPDX-License-Identifier: Apache-2.0
"""The stream: any frame by its number, the same bytes however one gets to it."""

import dataclasses
import json
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

import tiscene as ts
from tests.world.test_edit_costs import count_calls
from tiscene.errors import (
    ArgumentError,
    BufferNotFound,
    CameraNotFound,
    MissingFile,
    SceneNotFound,
    StageError,
    TemplateNotFound,
)
from tiscene.frame.buffers import BUFFERS
from tiscene.render.view import View
from tiscene.scene.lights.light_groups import emission_of, with_emission
from tiscene.stream.saved_state import check_state

SETTINGS = {
    "width": 32,
    "height": 24,
    "spp": 2,
    "max_depth": 3,
    "seed": 5,
    "buffers": tuple(BUFFERS),
    "incremental": True,
}

DIGESTS = """
import hashlib, json, sys
import tiscene as ts
from tiscene.device import runtime
from tests.stream.test_stream import SETTINGS, moving_scenario
runtime.start(threads=int(sys.argv[1]))
frame = ts.Stream(moving_scenario(), **SETTINGS)[7]
print(json.dumps({name: hashlib.sha256(array.tobytes()).hexdigest() for name, array in frame.buffers.items()}))
"""


def moving_scenario() -> ts.Scenario:
    path = [ts.Waypoint((-0.4, 0.0, 0.0)), ts.Waypoint((0.4, 0.2, 0.0), (0, 90, 0)), ts.Waypoint((0.0, -0.2, 0.3))]
    return ts.Scenario(
        "object_view",
        [
            ts.Object("cube", "Cube", (-0.4, 0.0, 0.0), dynamic=ts.LinearWaypoints(path, total_time=1.0)),
            ts.Object("dish", "Dish 01", (0, 0, 0), dynamic=ts.CatmullWaypoints(path, total_time=2.0), first_frame=3),
            ts.Object("ball", "Sphere", (0.5, 0.0, -0.5), last_frame=8),
        ],
        timings=ts.AllTogether(0.0),
        camera=ts.Camera.look_at((0.0, 0.3, 2.0), (0.0, 0.0, 0.0)),
    )


def same(left: ts.Frame, right: ts.Frame) -> bool:
    return (
        left.index == right.index
        and list(left) == list(right)
        and all(left[name].tobytes() == right[name].tobytes() for name in left)
    )


def test_a_frame_by_number_is_the_frame_of_iterating():
    iterated = list(ts.Stream(moving_scenario(), frames=10, **SETTINGS))
    assert [frame.index for frame in iterated] == list(range(10))
    stream = ts.Stream(moving_scenario(), **SETTINGS)
    for index in (7, 2, 9, 0):
        assert same(stream[index], iterated[index])
    assert stream.position == 0
    assert [same(left, right) for left, right in zip(stream[3:9:2], iterated[3:9:2], strict=True)] == [True] * 3
    assert same(next(stream.seek(8)), iterated[8])
    assert stream.position == 9


@pytest.mark.parametrize("threads", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_another_process_gives_the_same_bytes_on_any_number_of_threads(threads):
    here = {name: array.tobytes() for name, array in ts.Stream(moving_scenario(), **SETTINGS)[7].buffers.items()}
    done = subprocess.run(
        [sys.executable, "-c", DIGESTS, str(threads)], capture_output=True, text=True, check=True, env=dict(os.environ)
    )
    import hashlib

    assert json.loads(done.stdout) == {name: hashlib.sha256(data).hexdigest() for name, data in here.items()}


def test_settings_that_would_not_be_followed_cannot_be_changed():
    stream = ts.Stream(moving_scenario(), **SETTINGS)
    for name, value in (("seed", 6), ("fps", 30.0), ("shutter", (0.0, 0.5)), ("time_code", 3.0)):
        before = getattr(stream, name)
        with pytest.raises(ArgumentError, match=f"{name}=.*cannot change its {name}; make a new Stream"):
            setattr(stream, name, value)
        assert getattr(stream, name) == before
    stream.restart(stream.scenario)
    assert stream.another(stream.scenario).seed == stream.seed


def test_a_stream_resumes_from_its_state():
    stream = ts.Stream(moving_scenario(), frames=10, **SETTINGS)
    stream.seek(6)
    state = json.loads(json.dumps(stream.state_dict()))
    assert len(json.dumps(state)) < 1000
    resumed = ts.Stream(moving_scenario(), frames=10, **SETTINGS)
    resumed.load_state_dict(state)
    assert [frame.index for frame in resumed] == [6, 7, 8, 9]
    other = ts.Stream(moving_scenario(), **{**SETTINGS, "seed": 6})
    with pytest.raises(ArgumentError, match="seed: 5 there, 6 here"):
        other.load_state_dict(state)
    with pytest.raises(ArgumentError, match="not a state_dict"):
        other.load_state_dict({})
    with pytest.raises(ArgumentError, match="not a state_dict"):
        other.load_state_dict({"version": 1, "settings": 3, "position": 0})


def test_state_costs_the_same_whatever_the_number_of_edits_before_the_last_state():
    stream = ts.Stream(moving_scenario(), frames=10, **SETTINGS)
    calls = []
    for _ in range(2):
        stream.state_dict()
        calls.append(count_calls(stream.state_dict))
        for _ in range(50):
            stream.world.move_camera((0, 0, 0))
    assert calls[0] == calls[1]


@pytest.mark.parametrize(
    ("setting", "cure"),
    [
        ("seed", r"Pass the saved seed to Stream\(\.\.\.\)\."),
        ("scenario", r"Make the stream from the saved scenario, edits included \(stream\.scenario\.save\(\.\.\.\)\)\."),
        ("files", r"The files of the scene or of a template have changed: restore them, or start again\."),
    ],
)
def test_state_of_another_stream_is_refused_with_the_cure(setting, cure):
    settings = {"seed": 5, "scenario": "ab", "files": "cd"}
    state = {"version": 1, "position": 0, "settings": settings}
    check_state(state, settings)
    with pytest.raises(ArgumentError, match=rf"another stream \({setting}: .* there, 'other' here\)\. {cure}$"):
        check_state(state, settings | {setting: "other"})


def test_length_and_bounds():
    finite = ts.Stream(moving_scenario(), frames=4, **SETTINGS)
    assert len(finite) == 4
    assert finite[-1].index == 3
    assert len(finite[1:]) == 3
    assert repr(finite[1:]) == "<FrameSlice of range(1, 4)>"
    for outside in (4, -5):
        with pytest.raises(IndexError, match=rf"frame {outside} is outside 0\.\.3"):
            finite[outside]
    endless = ts.Stream(moving_scenario(), **SETTINGS)
    with pytest.raises(TypeError, match="no length"):
        len(endless)
    with pytest.raises(IndexError, match="negative"):
        endless[-1]
    with pytest.raises(IndexError, match="frame 9223372036854775808 is outside"):
        endless[2**63]
    with pytest.raises(ArgumentError, match="counted from its end"):
        endless[-3:]
    with pytest.raises(ArgumentError, match="counted from its end"):
        endless[::-1]
    assert list(endless[2::-1].indices) == [2, 1, 0]


def test_objects_live_from_their_first_to_their_last_frame():
    stream = ts.Stream(moving_scenario(), **SETTINGS)
    assert [row.name for row in stream[0].objects] == ["cube", "ball"]
    assert [row.name for row in stream[3].objects] == ["cube", "dish", "ball"]
    assert [row.name for row in stream[9].objects] == ["cube", "dish"]


def test_only_the_buffers_asked_for_are_there():
    frame = ts.Stream(moving_scenario(), width=16, height=12, buffers=("depth",))[0]
    assert set(frame.buffers) == {"depth"}
    with pytest.raises(AttributeError, match="buffers="):
        frame.rgb  # noqa: B018


def test_denoising_changes_rgb_and_never_hdr():
    noisy = ts.Stream(moving_scenario(), **SETTINGS, denoise=False)[2]
    clean = ts.Stream(moving_scenario(), **SETTINGS, denoise=True)[2]
    assert np.array_equal(noisy.hdr, clean.hdr)
    assert not np.array_equal(noisy.rgb, clean.rgb)


def test_paths_until_the_error_is_small_enough():
    settings = {**SETTINGS, "buffers": ("hdr", "depth"), "incremental": None, "spp": 48, "relative_error": 0.1}
    stream = ts.Stream(moving_scenario(), **settings)
    assert not stream.render_settings.incremental  # though it is endless
    frame = stream[4]
    assert 16 < frame.spp < 48
    again = ts.Stream(moving_scenario(), **settings)[4]
    assert (again.hdr.tobytes(), again.spp) == (frame.hdr.tobytes(), frame.spp)
    assert ts.Stream(moving_scenario(), **{**settings, "spp": None}).render_settings.spp == 1024
    assert ts.Stream(moving_scenario(), **{**settings, "buffers": ("depth",)})[4].spp == 0.0


def test_no_error_is_promised_while_a_shutter_is_open():
    settings = {**SETTINGS, "buffers": ("hdr",), "incremental": None, "relative_error": 0.1, "spp": 16}
    with pytest.raises(ArgumentError, match=r"relative_error=0.1: not with shutter=\(0, 0.5\); give spp="):
        ts.Stream(moving_scenario(), **settings, shutter=(0, 0.5))
    camera = dataclasses.replace(ts.Stream(moving_scenario(), **settings).world.camera, shutter_close=0.5)
    with pytest.raises(ArgumentError, match=r"relative_error=0.1: not available with an open shutter; give spp="):
        ts.Stream(moving_scenario(), **settings, camera=camera)[4]
    assert ts.Stream(moving_scenario(), **settings, shutter=(0, 0))[4].spp == 16


def test_clamps_and_filters_change_color_alone():
    settings = {**SETTINGS, "buffers": ("hdr", "depth", "coverage"), "incremental": False}
    plain = ts.Stream(moving_scenario(), **settings)[4]
    assert plain.spp == 2
    brightest = float(plain.hdr.max())
    for option in ({"clamp": 0.3 * brightest}, {"pixel_filter": "mitchell"}, {"pixel_filter": "gaussian"}):
        other = ts.Stream(moving_scenario(), **settings, **option)[4]
        assert not np.array_equal(other.hdr, plain.hdr)
        assert np.array_equal(other.coverage, plain.coverage)
        assert np.array_equal(other.depth, plain.depth)
        if "clamp" in option:
            assert other.hdr.max() <= 0.3 * brightest * 1.0001
            assert (other.hdr <= plain.hdr * 1.0001).all()


@pytest.mark.parametrize(
    ("error", "message", "source", "arguments"),
    [
        (SceneNotFound, "Did you mean 'room_02'", "room_2", {}),
        (MissingFile, "nowhere.usda", "nowhere.usda", {}),
        (BufferNotFound, "Did you mean 'depth'", "object_view", {"buffers": ("dept",)}),
        (ArgumentError, "sequence of names", "object_view", {"buffers": "rgb"}),
        (ArgumentError, "width=0: must be from 1", "object_view", {"width": 0}),
        (ArgumentError, "at most 134217728 pixels", "object_view", {"width": 16384, "height": 16384}),
        (ArgumentError, "height=1.5: must be a whole number", "object_view", {"height": 1.5}),
        (ArgumentError, "fps=-1", "object_view", {"fps": -1}),
        (ArgumentError, "fps='fast'", "object_view", {"fps": "fast"}),
        (ArgumentError, "variants=3 must be a mapping", "object_view", {"variants": 3}),
        (ArgumentError, "time_code='noon': must be a number", "object_view", {"time_code": "noon"}),
        (ArgumentError, "frames=0", "object_view", {"frames": 0}),
        (ArgumentError, "quality='best'", "object_view", {"quality": "best"}),
        (ArgumentError, r"quality=\[\]", "object_view", {"quality": []}),
        (ArgumentError, r"pixel_filter=\[\]", "object_view", {"pixel_filter": []}),
        (ArgumentError, "source=3: must be a Scenario, a scene's name or a file", 3, {}),
        (ArgumentError, "root=3: must be a folder", "object_view", {"root": 3}),
        (ArgumentError, "limits=60: must be ts.Limits", "object_view", {"limits": 60}),
        (ArgumentError, "untrusted='no': must be True or False", "object_view", {"untrusted": "no"}),
        (ArgumentError, "strict=1: must be True or False", "object_view", {"strict": 1}),
        (ArgumentError, "incremental='no': must be True or False", "object_view", {"incremental": "no"}),
        (ArgumentError, "denoise='off': must be True or False", "object_view", {"denoise": "off"}),
        (ArgumentError, "spp=0", "object_view", {"spp": 0}),
        (ArgumentError, "max_depth=1000000: must be from 1 to 1024", "object_view", {"max_depth": 1_000_000}),
        (ArgumentError, "relative_error=2.0: must lie between 0 and 1", "object_view", {"relative_error": 2.0}),
        (ArgumentError, "clamp=-1.0: must be greater than 0", "object_view", {"clamp": -1.0}),
        (ArgumentError, "pixel_filter='sinc': must be one of box", "object_view", {"pixel_filter": "sinc"}),
        (
            ArgumentError,
            "incremental=True: not with relative_error=",
            "object_view",
            {"incremental": True, "relative_error": 0.1},
        ),
        (ArgumentError, "arch='metal'", "object_view", {"arch": "metal"}),
        (CameraNotFound, "no camera 'Nobody'", "object_view", {"camera": "Nobody"}),
        (TemplateNotFound, "Did you mean 'Chair 01'", ts.Scenario("object_view", [ts.Object("c", "Chair 1")]), {}),
    ],
)
def test_bad_arguments_say_what_to_do(error, message, source, arguments):
    with pytest.raises(error, match=message):
        ts.Stream(source, **arguments)


@pytest.mark.parametrize("batch", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_frames_of_a_stream_cost_as_many_calls_after_200_edits_as_after_20(batch):
    stream = ts.Stream(
        "object_view", width=8, height=6, buffers=("rgb",), quality="fast", spp=1, base_spp=1, batch=batch
    )
    calls = []
    for _ in range(100):
        spawned = stream.world.spawn("Cube", (0.0, 0.1, 0.4))
        calls.append(count_calls(lambda: next(stream)))
        stream.world.despawn(spawned)
        next(stream)
    assert stream.world.edit_count == 200
    assert np.median(calls[-5:]) < 1.1 * np.median(calls[5:10])


def test_an_edited_stream_replays_exactly(tmp_path):
    """Spawned, moved and gone while it runs: seeking, the saved scenario and another stream give the same bytes."""
    stream = ts.Stream(moving_scenario(), **SETTINGS)
    before = stream.state_dict()
    seen = []
    for index in range(8):
        if index == 3:
            number = stream.world.spawn("Cube", (0.0, 0.1, 0.4), dynamic=ts.UniformMovementRandomBounce(0.5, seed=1))
        if index == 5:
            stream.world.move("ball", (-0.3, 0.2, 0.2))
        if index == 7:
            stream.world.despawn(number)
        seen.append(next(stream))
    shown = [number in frame.instance for frame in seen]
    assert shown == [False] * 3 + [True] * 4 + [False]
    assert [event.kind for event in seen[3].events if event.object == number] == ["spawn", "overlap", "enter"]
    assert [event.kind for event in seen[7].events if event.object == number][:1] == ["despawn"]
    # Not anticipated: the frame before the move knows nothing of it.
    assert [row.velocity for row in seen[4].objects if row.name == "ball"] == [(0.0, 0.0, 0.0)]
    stream.scenario.save(tmp_path / "edited.json")
    replay = ts.Stream(tmp_path / "edited.json", **SETTINGS)
    assert replay.scenario == stream.scenario
    for index in (7, 3, 4, 2, 6):
        assert same(replay[index], seen[index])
        assert same(stream[index], seen[index])
    assert stream.state_dict()["settings"] == replay.settings()
    with pytest.raises(ArgumentError, match="edits included"):
        stream.load_state_dict(before)
    assert repr(replay.seek(3)) == f"<Stream of {replay.scenario.scene} at frame 3: {', '.join(replay.buffers)}>"


def test_many_sizes_are_rendered_and_few_are_kept():
    stream = ts.Stream("object_view", buffers=("instance",), width=8, height=8)
    camera = stream[0].camera.camera
    for width in (8, 9, 10, 11, 12, 13, 8):
        frame = stream.render_view(0, View(camera, camera, camera, width, 8), ("instance",))
        assert frame.instance.shape == (8, width)


def test_a_stream_can_be_sent_to_another_process():
    """As it is: edits, place and settings; so can its frames."""
    stream = ts.Stream(moving_scenario(), **SETTINGS, progress=lambda doing, done: None)
    stream.seek(2).world.spawn("Cube", (0.0, 0.1, 0.4))
    sent = pickle.loads(pickle.dumps(stream))
    assert sent.state_dict() == stream.state_dict()
    frame = next(stream)
    assert same(next(sent), frame)
    assert same(pickle.loads(pickle.dumps(frame)), frame)
    assert [row.name for row in pickle.loads(pickle.dumps(frame)).objects] == [row.name for row in frame.objects]


def test_stream_is_a_context_manager_and_can_be_restarted():
    with ts.Stream("object_view", width=8, height=6, buffers=("instance",)) as stream:
        first = next(stream)
    assert repr(stream) == "<Stream, closed>"
    with pytest.raises(ArgumentError, match="this stream is closed"):
        next(stream)
    stream.close()
    stream.restart(ts.Scenario("object_view"))
    assert same(next(stream), first)


def test_limits_bound_the_reading_of_trusted_stages(tmp_path):
    path = tmp_path / "box.usda"
    path.write_text('#usda 1.0\n(\n    metersPerUnit = 1\n)\ndef Cube "Box" {}\n')
    with pytest.raises(StageError, match=r"box\.usda.*\n.*longer than 0\.01 s"):
        ts.Stream(path, width=8, height=6, buffers=("instance",), limits=ts.Limits(seconds=0.01))
    ts.Stream(path, width=8, height=6, buffers=("instance",), limits=ts.Limits(seconds=60.0))[0]


def test_automatic_exposure_is_that_of_a_replay_after_edits_of_the_first_frame():
    settings = {**SETTINGS, "buffers": ("rgb",), "incremental": False}
    with ts.Stream(moving_scenario(), **settings) as stream:
        before = stream.exposure
        stream.world.spawn("Cube", (0, 0.3, 1.2), scale=0.5)  # before the camera: less light is seen
        frame, exposure = stream[0], stream.exposure
        scenario = stream.scenario
    with ts.Stream(scenario, **settings) as replay:
        assert replay.exposure == exposure != before
        assert same(replay[0], frame)


@pytest.mark.parametrize("shown_before", [False, True])
def test_automatic_exposure_is_that_of_the_lights_of_the_scenario(shown_before):
    settings = {**SETTINGS, "buffers": ("rgb",), "incremental": False}
    with ts.Stream(moving_scenario(), **settings) as stream:
        lit = stream[0]
        exposure = stream.exposure
    with ts.Stream(moving_scenario(), **settings) as stream:
        if shown_before:
            assert same(stream[0], lit)
        for row, light in enumerate(stream.world.stage.lights):
            stream.set_light(row, with_emission(light, tuple(0.25 * each for each in emission_of(light))))
        assert stream[0].rgb.mean() < 0.8 * lit.rgb.mean()
        assert stream.exposure == exposure
