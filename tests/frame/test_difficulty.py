# SPDX-License-Identifier: Apache-2.0
"""Measures of difficulty: equal to what labels worked out by hand give, and a pure function of the frame."""

import gc
import math
import pickle
import threading
import weakref
from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tiscene.device import runtime
from tiscene.export.difficulty_plot import difficulty_plot
from tiscene.frame.difficulty import BAND, MEASURES, NEVER_SHOWN, Difficulty, summary
from tiscene.frame.frame import Frame, FrameCamera
from tiscene.frame.object_table import ObjectTable
from tiscene.scenario.scenario import Scenario

EYE = ts.Camera((0, 0, 4), vertical_fov=math.radians(60), exposure=0.0)
TURN = ts.Object("turning", "Cube", dynamic=ts.Orbit((0, 0, 0), period=8.0))  # turns in its place
STILL = ts.Object("still", "Cube", dynamic=ts.Still())
BUFFERS = ("instance", "forward_flow")


def stream(*objects, camera=EYE, buffers=BUFFERS, fps=10, **others):
    scenario = Scenario("object_view", objects, camera=camera)
    return ts.Stream(scenario, width=64, height=48, fps=fps, buffers=buffers, **others)


@pytest.fixture(scope="module")
def turning():
    with stream(TURN) as made:
        yield made


def test_counts_size_visibility_and_motion_are_those_of_the_labels(turning):
    frame = turning[3]
    measured = frame.difficulty
    mask = frame.instance == 1
    moves = np.linalg.norm(frame.forward_flow, axis=2) >= 0.1
    assert (measured.instances, measured.categories) == (1, 1)
    assert measured.size == mask.sum() / mask.size
    assert measured.visibility == pytest.approx(1.0, abs=0.05)
    assert measured.moving == moves.mean()
    assert measured.motion == pytest.approx(np.linalg.norm(frame.forward_flow, axis=2)[moves].mean())
    assert measured.contrast is None


def test_novelty_is_the_angle_turned_since_a_second_ago_and_none_after_a_lap(turning):
    """A turn takes 80 frames: 4.5 degrees each. Views are evaluated at every fifth frame."""
    assert turning[9].difficulty.novelty == NEVER_SHOWN
    for frame in (10, 22, 29):
        assert turning[frame].difficulty.novelty == pytest.approx(4.5 * (10 + frame % 5), abs=1e-6)
    assert turning[95].difficulty.novelty == pytest.approx(0.0, abs=1e-5)
    assert turning[97].difficulty.novelty == pytest.approx(9.0, abs=1e-5)


def test_difficulty_does_not_depend_on_what_was_rendered_before(turning):
    before = turning[40].difficulty
    with stream(TURN) as other:
        assert other[40].difficulty == before
        assert pickle.loads(pickle.dumps(other[40])).difficulty == before


def test_view_out_of_the_image_was_not_shown():
    aside = replace(EYE, position=(50, 0, 4))
    with stream(replace(TURN, id="a"), camera=aside) as made:
        assert made[30].difficulty.novelty is None  # it is not visible
        made.world.next_frame = 20
        made.world.move_camera((0, 0, 4))
        assert made[25].difficulty.novelty == NEVER_SHOWN
        assert made[40].difficulty.novelty < 90


def test_edit_of_the_camera_keeps_earlier_views():
    with stream(STILL) as made:
        assert made[30].difficulty.novelty == pytest.approx(0.0, abs=1e-6)
        made.world.next_frame = 31
        made.world.move_camera((4, 0, 0), (0, 90, 0))
        assert made[31].difficulty.novelty == pytest.approx(90.0, abs=1e-6)
        assert made[30].difficulty.novelty == pytest.approx(0.0, abs=1e-6)
        assert made[45].difficulty.novelty == pytest.approx(0.0, abs=1e-6)


def test_edit_does_not_change_the_novelty_of_a_frame_that_is_kept():
    """Whether it was read before or not."""
    with stream(TURN) as made:
        read, kept, earlier = made[40], made[40], made[20]
        before = read.difficulty
        made.seek(21)
        made.world.move_camera((4, 0, 0), (0, 90, 0))
        assert kept.difficulty == read.difficulty == before
        assert made[40].difficulty.novelty != pytest.approx(before.novelty, abs=1.0)
        assert earlier._novelty.history is not None, "it is not evaluated: the edit comes later"


def test_edit_at_the_frame_that_is_kept_does_not_change_its_novelty():
    with stream(STILL) as made:
        kept = made[40]
        made.seek(40)
        made.world.move("still", (0, 0, 0), (0, 90, 0))
        assert kept.difficulty.novelty == pytest.approx(0.0, abs=1e-6)
        assert made[40].difficulty.novelty == pytest.approx(90.0, abs=1e-6)


def test_edit_at_a_frame_whose_view_is_known_changes_that_view():
    """Frame 30 is the last one whose view counts at frame 40."""
    with stream(STILL) as made:
        assert made[40].difficulty.novelty == pytest.approx(0.0, abs=1e-6)
        made.seek(30)
        made.world.move_camera((4, 0, 0), (0, 90, 0))
        assert made[40].difficulty.novelty == pytest.approx(0.0, abs=1e-6)


def test_views_of_the_last_64_seconds_count():
    """At 2 frames per second these are 128; only that of frame 0 is from the front."""
    with stream(STILL, fps=2) as made:
        for frame, pose in ((1, ((4, 0, 0), (0, 90, 0))), (129, ((0, 0, 4), (0, 0, 0)))):
            made.seek(frame)
            made.world.move_camera(*pose)
        assert made[129].difficulty.novelty == pytest.approx(0.0, abs=1e-6)
        assert made[130].difficulty.novelty == pytest.approx(90.0, abs=1e-6)


PARALLEL = replace(EYE, orthographic_height=3.0)


def test_orthographic_camera_that_moves_sideways_has_the_same_view():
    with stream(STILL, camera=PARALLEL) as made:
        made.seek(30)
        made.world.move_camera((0.5, 0.2, 4))
        assert made[30].difficulty.novelty == pytest.approx(0.0, abs=1e-6)


def test_object_straight_behind_the_camera_was_not_in_view():
    with stream(STILL, camera=replace(EYE, rotation=(0, 0, 1, 0))) as made:
        made.seek(20)
        made.world.move_camera((0, 0, 4), (0, 0, 0))
        assert made[25].difficulty.novelty == NEVER_SHOWN


@pytest.mark.parametrize("axis", [0, 1])
def test_lens_shift_decides_which_objects_were_in_view(axis):
    """The aperture is shifted by more than half its size: the object on the axis is out, one aside is in."""
    shift, place = [0.0, 0.0], [0.0, 0.0, 0.0]
    shift[axis], place[axis] = 1.0, 4.0
    with stream(STILL, replace(STILL, id="aside", position=place), camera=replace(EYE, aperture_offset=shift)) as made:
        camera = made.world.cameras[0]
        angles = made.world.view_history.angles(20, 0, camera)
    assert list(angles.values()) == [NEVER_SHOWN, pytest.approx(0.0, abs=1e-6)]


LOOPS = ts.Orbit((0.0, 1.0, -2.3), period=8.0)
BOUNCES = ts.UniformMovementRandomBounce(speed=1.0, start_direction=(0.3, -1, 0), seed=3)


@pytest.mark.parametrize("dynamic", [LOOPS, BOUNCES], ids=["formula", "simulated"])
def test_frame_that_is_kept_has_its_difficulty_after_the_end_of_its_stream(dynamic):
    ball = ts.Object("ball", "Ball 01", (0.0, 1.0, -2.0), dynamic=dynamic)
    scenario = Scenario("solid_benchmark", [ball])
    with ts.Stream(scenario, width=32, height=24, fps=10, buffers=BUFFERS) as made:
        expected = made[30].difficulty
        kept, pickled, restarted = made[30], made[30], made[30]
        assert expected.novelty > 0.0
        made.restart(Scenario("solid_benchmark"))
        assert restarted.difficulty == expected
    assert kept.difficulty == expected
    assert pickle.loads(pickle.dumps(pickled)).difficulty == expected


def test_novelty_waits_while_another_thread_renders(turning):
    """It simulates: a frame that is rendered meanwhile would be wrong."""
    novelty, found = turning[33]._novelty, []
    reader = threading.Thread(target=lambda: found.append(novelty.angles()))
    with runtime.ONE_THREAD:
        reader.start()
        reader.join(0.2)
        assert reader.is_alive()
    reader.join()
    assert found == [turning[33]._novelty.angles()]


def test_frame_whose_difficulty_was_read_does_not_keep_the_world():
    with stream(TURN) as made:
        frame, world = made[12], weakref.ref(made.world.trajectories)
        assert frame.difficulty.novelty is not None
    del made
    gc.collect()
    assert world() is None


def test_object_in_a_picture_that_shows_more_than_the_aperture_was_in_view():
    """An aperture three times as wide as high, in a picture of 4:3: it shows more above and below."""
    wide = ts.Camera((0, 0, 5), vertical_fov=math.radians(30), aspect=3.0, exposure=0.0)
    above = ts.Object("above", "Cube", (0, 1.7, 0), dynamic=ts.Still())
    with stream(above, camera=wide) as made:
        frame = made[30]
    assert frame.objects[0].fraction_in_frame == 1.0
    assert frame.difficulty.novelty == pytest.approx(0.0, abs=1e-6)


def test_without_objects_of_the_scenario_all_objects_are_targets():
    with ts.Stream("solid_benchmark", width=32, height=24, buffers=BUFFERS) as made:
        frame = made[0]
    measured = frame.difficulty
    shares = [row.visible_pixels / (32 * 24) for row in frame.objects if row.visible_pixels]
    assert measured.instances == len(shares)
    assert measured.size == pytest.approx(np.mean(shares))
    assert measured.novelty is None
    assert (measured.motion, measured.moving) == (0.0, 0.0)


def test_missing_buffers_give_none():
    with stream(TURN, buffers=("depth",)) as made:
        measured = made[0].difficulty
    assert (measured.motion, measured.moving, measured.contrast) == (None, None, None)
    assert measured.instances == 1


class Row:
    id, template, category, visible_pixels, _row = 1, "Cube", "cube", 16, 0

    def __init__(self, **fields):
        vars(self).update(fields)


def made_frame(buffers, *rows):
    """Return a frame of 30 x 20 px with rows of objects that are wholly visible."""

    class Measures:
        def amodal_counts(self, rows):
            return np.array([[16, 16] for _ in rows])

    objects = ObjectTable(measures=Measures())
    objects.__dict__["_rows"] = rows
    return Frame(0, 0.0, FrameCamera(EYE, 30, 20), buffers, objects)


def test_contrast_is_between_an_object_and_the_band_around_it():
    """A made frame: an object of value 188 (luminance 0.5) before one of 137 (0.25), 0 beyond the band."""
    instance, rgb = np.zeros((20, 30), np.int32), np.zeros((20, 30, 3), np.uint8)
    rgb[8 - BAND : 12 + BAND, 8 - BAND : 12 + BAND] = 137
    instance[8:12, 8:12], rgb[8:12, 8:12] = 1, 188
    a, b = (((value / 255 + 0.055) / 1.055) ** 2.4 for value in (188, 137))
    contrast = made_frame({"rgb": rgb, "instance": instance}, Row()).difficulty.contrast
    assert contrast == pytest.approx((a - b) / (a + b), rel=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("place", "share"), [(4, 0), (5, 1), (7, 1), (12, 1), (14, 1), (15, 0)])
def test_band_of_the_contrast_is_3_px_wide_on_each_side(axis, place, share):
    """A black object before a black picture with one white line, in the band or just beyond it."""
    instance, rgb = np.zeros((20, 30), np.int32), np.zeros((20, 30, 3), np.uint8)
    instance[8:12, 8:12] = 1
    rgb[(place, slice(None)) if axis == 0 else (slice(None), place)] = 255
    rgb[8:12, 8:12] = 0
    assert made_frame({"rgb": rgb, "instance": instance}, Row()).difficulty.contrast == share


def test_objects_without_a_category_are_not_counted_among_the_categories():
    measured = made_frame({}, Row(), Row(category=""), Row(category="ball"), Row(category="ball")).difficulty
    assert (measured.instances, measured.categories) == (4, 2)


def measured(**values) -> Difficulty:
    return Difficulty(**(dict.fromkeys(MEASURES) | {"instances": 1, "categories": 1} | values))


def test_summary_leaves_out_frames_without_a_value():
    result = summary([measured(motion=1.0), measured(motion=None), measured(motion=4.0)])
    assert result["motion"] == {"mean": 2.5, "min": 1.0, "max": 4.0}
    assert result["contrast"] == {"mean": None, "min": None, "max": None}
    assert list(measured().to_json()) == list(MEASURES)


def test_plot_is_a_picture_with_a_panel_for_each_measure_that_has_values():
    import io

    from PIL import Image

    rows = [measured(motion=k / 7, size=None if k == 3 else 0.1) for k in range(6)]
    image = Image.open(io.BytesIO(difficulty_plot([0, 5, 10, 15, 20, 25], rows, scale=1)))
    assert image.size == (2 * 420, 2 * 150)
    assert Image.open(io.BytesIO(difficulty_plot([4], rows[:1], scale=1))).size == (840, 300)
