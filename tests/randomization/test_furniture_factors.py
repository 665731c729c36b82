# SPDX-License-Identifier: Apache-2.0
"""The factors furniture and clutter: what is moved or added rests in free space."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.randomization.rooms import BOXES, write_room
from tiscene.errors import ScenarioError
from tiscene.scenario.overrides import ObjectOverride
from tiscene.scenario.scenario import Scenario


def boxes_of(scenario: Scenario) -> dict[str, np.ndarray]:
    """Return the corners [8, 3] of the movable boxes of `write_room_of_boxes` under a scenario's overrides."""
    corners = np.array(list(itertools.product((-0.1, 0.1), repeat=3)))
    result = {name: corners + place for name, place in BOXES.items()}
    for each in scenario.overrides:
        w, _, y, _ = each.rotation
        cosine, sine = 1 - 2 * y * y, 2 * w * y
        turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
        result[each.prim.rsplit("/")[-1]] = corners @ turn.T + each.position
    return result


def overlap(a: np.ndarray, b: np.ndarray) -> bool:
    """Return whether two boxes of corners [8, 3] that stand upright overlap: the separating axis theorem."""
    axes = [np.array([0.0, 1.0, 0.0])]
    axes += [(each[4] - each[0]) / np.linalg.norm(each[4] - each[0]) for each in (a, b)]
    axes += [(each[1] - each[0]) / np.linalg.norm(each[1] - each[0]) for each in (a, b)]
    return all(
        (a @ axis).max() > (b @ axis).min() + 1e-6 and (b @ axis).max() > (a @ axis).min() + 1e-6 for axis in axes
    )


def test_furniture_neither_penetrates_nor_leaves_its_support(room_of_boxes):
    moved = set()
    for seed in range(12):
        scenario = Scenario(room_of_boxes).with_factor("furniture", {"shift": (0.02, 0.5), "turn": (0, 45)}, seed=seed)
        assert all(isinstance(each, ObjectOverride) for each in scenario.overrides)
        boxes = boxes_of(scenario)
        moved |= {each.prim.rsplit("/")[-1] for each in scenario.overrides}
        for a, b in itertools.combinations(boxes, 2):
            assert not overlap(boxes[a], boxes[b]), (seed, a, b)
        for name, corners in boxes.items():
            assert corners[:, 1].min() == pytest.approx(BOXES[name][1] - 0.1, abs=1e-4)
        assert np.all(np.abs(boxes["OnTable"][:, [0, 2]] - (0.8, 0)) <= 0.4 + 0.013)
    assert moved == {"A", "OnTable"}  # B carries OnBox, which would lose a corner of its support


def test_furniture_keeps_clear_of_paths(room_of_boxes):
    way = ts.LinearWaypoints([ts.Waypoint((-0.6, 0.3, 0.5)), ts.Waypoint((-0.6, 0.3, 1.2))])
    scenario = Scenario(room_of_boxes, [ts.Object("ball", "Sphere", dynamic=way, scale=0.5)])
    for seed in range(8):
        corners = boxes_of(scenario.with_factor("furniture", {"shift": (0.0, 0.9)}, seed=seed))["A"]
        nearest = np.clip((-0.6, 0.3, 0.5), corners.min(0), corners.max(0))
        assert np.linalg.norm(nearest - (-0.6, 0.3, 0.5)) > 0.1


@pytest.mark.parametrize("more", [{"collide": False}, {"dynamic": ts.Still(), "rotation": (0, 90, 0)}])
def test_furniture_that_carries_an_object_of_the_scenario_stays(room_of_boxes, more):
    on_a = ts.Object("distractor_0", "Cup 01", (-0.6, 0.25, 0), **more)
    scenario = Scenario(room_of_boxes, [on_a])
    free = Scenario(room_of_boxes, [replace(on_a, position=(-0.6, 0.29, 0))])  # 4 cm higher: it rests on nothing
    for seed in range(4):
        moved, other = (
            {each.prim for each in each.with_factor("furniture", {"shift": (0.2, 0.5)}, seed=seed).overrides}
            for each in (scenario, free)
        )
        assert "/Room/A" in other
        assert moved == other - {"/Room/A"}


def test_furniture_variants_are_selected():
    scenario = Scenario("room_01").with_factor("furniture", {"variants": 1.0}, seed=3)
    assert scenario.variants["/Room01/Furniture/Chair{color}"] in ("chestnut", "oak", "walnut", "white")
    assert not any("lighting" in key or "appearance" in key for key in scenario.variants)


def test_clutter_rests_in_view_and_changes_no_motion(room_of_boxes):
    way = ts.LinearWaypoints([ts.Waypoint((-1, 0.6, 0.5)), ts.Waypoint((1, 0.6, 0.5))])
    scenario = Scenario(room_of_boxes, [ts.Object("ball", "Sphere", dynamic=way, scale=0.3)])
    cluttered = scenario.with_factor(
        "clutter", {"count": 6, "templates": ("Cup 01", "Ball 01"), "depth": (1, 4)}, seed=1
    )
    assert [each.id for each in cluttered.objects[1:]] == [f"distractor_{n}" for n in range(6)]
    assert len({each.position for each in cluttered.objects}) == 7
    with ts.Stream(cluttered, width=64, height=48, buffers=("instance",)) as stream:
        frame = stream[0]
        for each in frame.objects:
            if each.name.startswith("distractor_"):
                assert each.visible_pixels > 0
                low = each.world_bounds[0][1]
                assert min(abs(low - support) for support in (0, 0.2, 0.4, 0.6)) < 1e-3
                assert each.fraction_in_frame > 0.3
        poses = [stream[k].objects.by_name("ball").position for k in (0, 30, 60)]
    with ts.Stream(scenario, width=64, height=48, buffers=("instance",)) as stream:
        assert poses == [stream[k].objects.by_name("ball").position for k in (0, 30, 60)]
    assert cluttered.with_factor("clutter", 0) == scenario


def test_clutter_that_fits_nowhere_raises(room_of_boxes):
    with pytest.raises(ScenarioError, match=r"'distractor_0' rests nowhere in view.*lower count or scale"):
        Scenario(room_of_boxes).with_factor("clutter", {"count": 1, "templates": ("Cup 01",), "scale": 90})


def test_clutter_does_not_rest_where_a_prim_that_the_scenario_moves_was(tmp_path):
    cubes = {"Floor": ((0, -0.05, 0), (3, 0.05, 3)), "Table": ((0, 0.2, 0), (1.5, 0.2, 1.5))}
    room = write_room(tmp_path, (0, 1, 2.5), cubes)
    away, near = (Scenario(room, [ts.Object("table", "/Room/Table", (0, 0.2, z))]) for z in (9, 0.05))
    ranges = {"count": 4, "templates": ("Cup 01",), "depth": (1, 4)}
    for scenario, support in ((Scenario(room), 0.4), (away, 0.0), (near, 0.0)):
        cluttered = scenario.with_factor("clutter", ranges, seed=1)
        with ts.Stream(cluttered, width=8, height=6, buffers=("instance",)) as stream:
            cups = [each for each in stream[0].objects if each.template == "Cup 01"]
        np.testing.assert_allclose([each.world_bounds[0][1] for each in cups], [support] * 4, atol=1e-3)
    assert all(max(abs(each.position[0]), abs(each.position[2])) > 1.5 for each in cups)  # not inside of the table


def test_factors_of_a_scenario_that_moves_a_prim_with_a_light(tmp_path):
    lamp = """
    def Xform "Lamp" (kind = "component") {
        def Cube "Shade" { double size = 0.2
        }
        def SphereLight "Bulb" { float inputs:radius = 0.3
        }
    }"""
    room = write_room(tmp_path, (0, 1, 2.5), {"Floor": ((0, -0.05, 0), (3, 0.05, 3))}, lamp)
    scenario = Scenario(room, [ts.Object("lamp", "/Room/Lamp", (0, 0.5, 0), dynamic=ts.Orbit((0, 0.5, 0.3)))])
    lit = scenario.with_factor("illumination", {"strength": 2.0}).with_factor("materials", 0.5)
    with ts.Stream(lit, width=8, height=6, buffers=("instance",)) as stream:
        assert stream[0].objects.by_name("lamp").id
    with pytest.raises(ScenarioError, match="rooms: the prim '/Room/Lamp'"):
        scenario.with_factor("rooms", "object_view")
