# SPDX-License-Identifier: Apache-2.0
"""Objects that are spawned at free places."""

import numpy as np
import pytest

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import ArgumentError, ScenarioError

SIZE = {"width": 32, "height": 24, "buffers": ("instance", "depth")}
# A hall with a pillar in the middle, seen from one end.
HALL = {
    "Floor": ((0, -0.05, 0), (4, 0.1, 8)),
    "Left": ((-2.05, 1.5, 0), (0.1, 3, 8)),
    "Right": ((2.05, 1.5, 0), (0.1, 3, 8)),
    "Back": ((0, 1.5, -4.05), (4, 3, 0.1)),
    "Pillar": ((0, 1.5, -1), (0.8, 3, 0.8)),
}  # center and size of each box, m
CAMERA = ts.Camera((0.0, 1.5, 3.5))


@pytest.fixture(scope="module")
def hall(tmp_path_factory) -> str:
    boxes = "".join(
        f'def Cube "{name}" {{\ndouble size = 1\ndouble3 xformOp:translate = {center}\nfloat3 xformOp:scale = {size}\n'
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]\n}\n'
        for name, (center, size) in HALL.items()
    )
    return str(write(tmp_path_factory.mktemp("hall"), f'def Xform "World" {{\n{boxes}}}'))


def make(hall: str, seed: int = 1, camera: ts.Camera = CAMERA, **others) -> ts.Stream:
    return ts.Stream(ts.Scenario(hall, camera=camera, **others), seed=seed, **SIZE)


def spawned(stream: ts.Stream, number: int) -> dict:
    return next(row for row in next(stream).objects if row.id == number)


def gap(center: np.ndarray, box: tuple) -> float:
    """Return the distance of a point from a box."""
    middle, size = (np.array(each) for each in box)
    return float(np.linalg.norm(np.maximum(np.abs(center - middle) - 0.5 * size, 0.0)))


def test_free_place_is_visible_and_apart_from_everything(hall):
    with make(hall) as stream:
        radius = 0.13
        numbers = [stream.world.spawn("Ball 01", free=True) for _ in range(6)]
        frame = next(stream)
        assert [event for event in frame.events if event.kind == "overlap"] == []
        rows = [row for row in frame.objects if row.id in numbers]
        places = np.array([row.position for row in rows])
        for row, place in zip(rows, places, strict=True):
            assert min(gap(place, box) for box in HALL.values()) > radius
            assert 1.0 <= CAMERA.position[2] - place[2] <= 5.0
            assert row.visible_pixels > 0
        apart = np.linalg.norm(places[:, None] - places[None], axis=2) + 9.0 * np.eye(6)
        assert apart.min() > 2.0 * radius


def test_region_and_depth_bound_the_place(hall):
    with make(hall) as stream:
        numbers = [stream.world.spawn("Cup 01", free=True, region=(0.6, 0.2, 1.0, 0.8), depth=(1, 2)) for _ in range(4)]
        frame = next(stream)
        for row in frame.objects:
            if row.id in numbers:
                x, y, z = frame.camera.camera_from_world[:3] @ (*row.position, 1.0)
                u, v, _ = frame.camera.K @ (x, y, z) / z
                assert 0.6 <= (u + 0.5) / 32 <= 1.0
                assert 0.2 <= (v + 0.5) / 24 <= 0.8
                assert 1.0 <= z <= 2.0


def test_place_depends_on_seed_frame_and_number_alone_and_replays(hall):
    def positions(seed: int, skipped: int = 0, shown: int = 0) -> list:
        with make(hall, seed) as stream:
            stream[shown]
            stream.seek(3 + skipped)
            for _ in range(2):
                stream.world.spawn("Ball 01", free=True)
            return [edit.object.position for edit in stream.scenario.edits]

    first = positions(1)
    assert first[0] != first[1]
    assert positions(1, shown=9) == first
    assert positions(2)[0] != first[0]
    assert positions(1, skipped=1)[0] != first[0]
    with make(hall) as stream:
        stream.seek(3)
        stream.world.spawn("Ball 01", free=True)
        shown, saved = stream[3].instance, ts.Scenario.from_json(stream.scenario.to_json())
    with ts.Stream(saved, seed=99, **SIZE) as replay:
        np.testing.assert_array_equal(replay[3].instance, shown)
        assert replay.scenario.edits[0].object.position == first[0]


def test_edits_of_the_stage_change_what_is_free(hall):
    behind = {"region": (0.45, 0.4, 0.55, 0.6), "depth": (4.4, 4.6)}  # inside of the pillar
    with make(hall) as stream:
        with pytest.raises(ScenarioError, match="fits nowhere at frame 0 in region"):
            stream.world.spawn("Ball 01", free=True, **behind)
        assert stream.scenario.edits == ()
        stream.world.despawn("/World/Pillar")
        number = stream.world.spawn("Ball 01", free=True, **behind)
        x, _, z = spawned(stream, number).position
        assert gap(np.array((x, 1.5, z)), HALL["Pillar"]) == 0.0


def test_moving_camera_counts_as_it_is_at_the_spawn(hall):
    turn = ts.Orbit((0.0, 1.5, 3.5), period=2.0)
    with make(hall, camera=ts.Camera((0.0, 1.5, 3.5), dynamic=turn)) as stream:
        for frame in (0, 5):
            stream.seek(frame)
            number = stream.world.spawn("Cup 01", free=True, depth=(1, 1.5))
            assert next(row for row in stream[frame].objects if row.id == number).fraction_in_frame > 0.0


def test_bouncing_object_starts_at_the_free_place(hall):
    with make(hall) as stream:
        number = stream.world.spawn("Ball 01", dynamic=ts.UniformMovementRandomBounce(1.0), free=True, id="b")
        assert spawned(stream, number).position == stream.scenario.edits[0].object.position


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"position": (0, 1, 0)}, "leave position out"),
        ({"dynamic": ts.LinearWaypoints([ts.Waypoint((0, 1, 0)), ts.Waypoint((1, 1, 0))], 2.0)}, "has its own start"),
        ({"region": (0.5, 0, 0.2, 1)}, "region=.*left < right"),
        ({"depth": (0, 2)}, "depth=.*greater than 0"),
    ],
)
def test_contradicting_arguments_raise_and_change_nothing(hall, arguments, message):
    with make(hall) as stream:
        with pytest.raises(ArgumentError, match=message):
            stream.world.spawn("Ball 01", free=True, **arguments)
        assert stream.scenario.edits == ()


def test_object_larger_than_the_hall_fits_nowhere(hall):
    with make(hall) as stream, pytest.raises(ScenarioError, match=r"'big'.*m about its origin.*no free point visible"):
        stream.world.spawn("Ball 01", free=True, id="big", scale=30.0)


def test_a_spawn_that_is_refused_leaves_no_trace(hall):
    def materials(refused: bool) -> tuple:
        buffers = ("instance", "material_coverage")
        with ts.Stream(ts.Scenario(hall, camera=CAMERA), width=32, height=24, buffers=buffers) as stream:
            if refused:
                with pytest.raises(ScenarioError, match="fits nowhere"):
                    stream.world.spawn("Cup 01", free=True, scale=50.0)
                with pytest.raises(ArgumentError, match="leave position out"):
                    stream.world.spawn("Ball 01", (0, 0, 0), free=True)
            stream.world.spawn("Cube", (0.0, 1.5, 1.0))
            frame = next(stream)
            return frame.material_coverage.tobytes(), dict(frame.materials), stream.world.templates

    assert materials(refused=True) == materials(refused=False)
