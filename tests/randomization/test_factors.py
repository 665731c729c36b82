# SPDX-License-Identifier: Apache-2.0
"""Factors of variation: each changes its own aspect of a scenario and nothing else, repeatably."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest

import tiscene as ts
from dynamics import Body, Simulation, UniformMovementRandomBounce
from tests.usd.helpers import write
from tiscene import catalog
from tiscene.errors import ArgumentError, CameraNotFound, ScenarioError, SceneNotFound, TemplateNotFound, UnknownName
from tiscene.randomization.factor_ranges import IlluminationRanges
from tiscene.randomization.factors import FACTORS
from tiscene.randomization.object_factors import faster
from tiscene.randomization.scene_files import stage_of
from tiscene.scenario.edits import Despawn
from tiscene.scenario.overrides import CameraOverride, LightOverride, MaterialOverride, ObjectOverride
from tiscene.scenario.scenario import Scenario

# A floor, a low table, and on them boxes of 0.2 m of which all but one are movable.
ROOM = """
def Xform "Room"
{
    def Camera "Eye"
    {
        float2 clippingRange = (0.1, 100)
        float focalLength = 0.2
        float verticalAperture = 0.24
        float horizontalAperture = 0.32
        double3 xformOp:translate = (0, 1, 2.5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Floor"
    {
        double3 xformOp:translate = (0, -0.05, 0)
        double3 xformOp:scale = (3, 0.05, 3)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    def Cube "Table"
    {
        double3 xformOp:translate = (0.8, 0.2, 0)
        double3 xformOp:scale = (0.4, 0.2, 0.4)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    BOXES
    def DistantLight "Sun"
    {
        float inputs:intensity = 2
    }
}
"""
PLACES = {
    "A": (-0.6, 0.1, 0),
    "B": (-0.3, 0.1, 0),
    "OnTable": (0.8, 0.5, 0),
    "OnBox": (-0.3, 0.3, 0),
    "Fixed": (0, 0.1, 0),
}


def box(name: str) -> str:
    x, y, z = PLACES[name]
    api = "" if name == "Fixed" else '(prepend apiSchemas = ["PhysicsRigidBodyAPI"])'
    return f"""
    def Cube "{name}" {api}
    {{
        double3 xformOp:translate = ({x}, {y}, {z})
        double3 xformOp:scale = (0.1, 0.1, 0.1)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }}"""


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> str:
    text = ROOM.replace("BOXES", "".join(box(name) for name in PLACES))
    return str(write(tmp_path_factory.mktemp("room"), text, name="room.usda", more='defaultPrim = "Room"'))


@pytest.fixture(scope="module")
def drawn() -> Scenario:
    return Scenario.sample("solid_benchmark", seed=3, objects=2, templates=("Cup 01", "Chair 02"), scale=0.5)


@pytest.mark.parametrize("factor", FACTORS)
def test_factor_is_repeatable_and_in_files(drawn, room, factor, tmp_path):
    drawn = Scenario(room) if factor == "furniture" else drawn
    value = {"rooms": "object_view", "clutter": 2}.get(factor)
    made = [drawn.with_factor(factor, value, seed=seed) for seed in (1, 1, 2)]
    assert made[0] == made[1] != drawn
    assert made[0] != made[2]
    assert Scenario.from_json(made[0].to_json()) == made[0]
    made[0].save(tmp_path / "run.usda")
    assert Scenario.load(tmp_path / "run.usda") == made[0]


CHANGES = {
    "categories": {"objects"},
    "clutter": {"objects"},
    "furniture": {"overrides", "variants"},
    "illumination": {"overrides", "variants", "exposure_compensation"},
    "instances": {"objects"},
    "materials": {"overrides"},
    "occlusion": {"objects"},
    "rooms": {"scene", "objects", "camera", "variants", "overrides"},
    "speed": {"objects"},
    "views": {"overrides", "camera"},
}


@pytest.mark.parametrize("factor", FACTORS)
def test_factor_changes_nothing_else(drawn, factor):
    other = drawn.with_factor(factor, {"rooms": "object_view", "clutter": 2}.get(factor), seed=4)
    changed = {name for name in vars(drawn) if getattr(other, name) != getattr(drawn, name)}
    assert changed <= CHANGES[factor]
    ids = [each.id for each in other.objects if not each.id.startswith("distractor_")]
    assert ids == [each.id for each in drawn.objects]
    if FACTORS[factor].keeps_motion and factor != "speed":
        assert [each.dynamic for each in other.objects][:2] == [each.dynamic for each in drawn.objects]


def test_order_of_factors_does_not_matter(drawn):
    factors = ("materials", "views", "illumination", "speed")
    made = []
    for order in (factors, factors[::-1]):
        scenario = drawn
        for factor in order:
            scenario = scenario.with_factor(factor, {"lighting": ()} if factor == "illumination" else None, seed=5)
        made.append(scenario)
    assert made[0] == made[1]


def test_factors_of_sample_leave_its_objects_as_they_were(drawn):
    ranges = {"seed": 3, "objects": 2, "templates": ("Cup 01", "Chair 02"), "scale": 0.5}
    varied = Scenario.sample(
        "solid_benchmark", **ranges, clutter=2, views=True, materials=0.5, illumination={"strength": (0.5, 2)}
    )
    assert varied.objects[:2] == drawn.objects
    assert len(varied.objects) == 4
    kinds = {type(each) for each in varied.overrides}
    assert kinds == {LightOverride, MaterialOverride, CameraOverride}
    assert Scenario.sample("solid_benchmark", **ranges, clutter=False, materials=None) == drawn


def test_speed_keeps_paths(drawn):
    fast = drawn.with_factor("speed", 2.0)
    for a, b in zip(drawn.objects, fast.objects, strict=True):
        slow, quick = (Simulation([Body(each.dynamic, each.position, each.rotation)]) for each in (a, b))
        for time in (0.3, 1.7, 4.0):
            np.testing.assert_allclose(slow.poses(time), quick.poses(time / 2), atol=1e-9)
    spread = drawn.with_factor("speed", (0.5, 0.9), seed=1)
    ratios = [faster_of(b) / faster_of(a) for a, b in zip(drawn.objects, spread.objects, strict=True)]
    assert all(0.5 <= 1 / ratio <= 0.9 for ratio in ratios)
    assert ratios[0] != ratios[1]


def faster_of(each: ts.Object) -> float:
    return getattr(each.dynamic, "parts", (each.dynamic,))[0].total_time


@dataclass(frozen=True)
class Wobble(ts.Stepped):
    """A trajectory of a user without a speed."""

    def begin(self, start):
        return start.position

    def advance(self, state, number):
        return state

    def pose(self, state):
        return ts.Waypoint(state)


def test_speed_of_each_kind_of_trajectory():
    keys = ts.Keyframes((0, 1), (ts.Waypoint((0, 0, 0)), ts.Waypoint((1, 0, 0))))
    assert faster(keys, 2.0, "a").times == (0, 0.5)
    assert faster(ts.LookAt((0, 0, 0), keys), 2.0, "a").motion.times == (0, 0.5)
    assert faster(ts.Orbit(period=3.0), 1.5, "a").period == 2.0
    bounce = faster(UniformMovementRandomBounce(1.0, 2.0), 3.0, "a")
    assert (bounce.speed, bounce.angular_speed) == (3.0, 6.0)
    with pytest.raises(ScenarioError, match="'a' moves by Wobble, whose speed is unknown"):
        faster(Wobble(), 2.0, "a")


def test_instances_stay_in_their_category_and_categories_do_not(drawn):
    def categories(scenario):
        return [catalog.templates()[catalog.template_variants(each.template)[0]].category for each in scenario.objects]

    other = drawn.with_factor("instances", seed=2)
    assert categories(other) == categories(drawn)
    assert all(a.template != b.template for a, b in zip(drawn.objects, other.objects, strict=True))
    assert {each.template for each in drawn.with_factor("instances", "Ball 01").objects} == {"Ball 01"}
    assert all(a != b for a, b in zip(categories(drawn), categories(drawn.with_factor("categories")), strict=True))
    others = categories(drawn.with_factor("categories", ("ball", "cup"), seed=2))
    assert all(b == "ball" or (b == "cup" and a != "cup") for a, b in zip(categories(drawn), others, strict=True))


def test_illumination_by_name_stops_and_ranges(drawn):
    night = drawn.with_factor("illumination", "night")
    assert dict(night.variants) == {"/SolidBenchmark{lighting}": "night"}
    assert not night.overrides
    assert drawn.with_factor("illumination", -1.5).exposure_compensation == -1.5
    lit = drawn.with_factor("illumination", {"strength": (0.5, 0.9), "color": 0.2, "yaw": 20}, seed=1)
    lights = [each for each in lit.overrides if isinstance(each, LightOverride)]
    assert len(lights) == len(stage_of(drawn).lights)
    assert all(0.5 <= each.intensity <= 0.9 and each.color != (1, 1, 1) for each in lights)
    assert all(each.yaw == 0.0 for each in lights)  # a rectangle and a sphere
    sky = Scenario("object_view").with_factor("illumination", {"yaw": (5, 20)}, seed=1)
    assert all(5 <= abs(each.yaw) <= 20 for each in sky.overrides)


def test_another_time_of_day_drops_overrides_of_lights_that_it_lacks():
    """By day the lamps of this room are off, so that its stage does not have them."""
    night = Scenario("room_01").with_factor("illumination", {"lighting": "night", "strength": (0.5, 2)}, seed=1)
    paths = {each.prim for each in night.overrides}
    assert any("Lamp" in path for path in paths)
    day = night.with_factor("illumination", {"lighting": ("day",)})
    assert not day.overrides
    moved = replace(night, variants={}).with_factor("speed", 1.0)
    assert {each.prim for each in moved.overrides} < paths


def boxes_of(scenario: Scenario) -> dict[str, np.ndarray]:
    """Return the corners [8, 3] of the movable boxes of ROOM under a scenario's overrides."""
    corners = np.array(list(itertools.product((-0.1, 0.1), repeat=3)))
    result = {name: corners + place for name, place in PLACES.items()}
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


def test_furniture_neither_penetrates_nor_leaves_its_support(room):
    moved = set()
    for seed in range(12):
        scenario = Scenario(room).with_factor("furniture", {"shift": (0.02, 0.5), "turn": (0, 45)}, seed=seed)
        assert all(isinstance(each, ObjectOverride) for each in scenario.overrides)
        boxes = boxes_of(scenario)
        moved |= {each.prim.rsplit("/")[-1] for each in scenario.overrides}
        for a, b in itertools.combinations(boxes, 2):
            assert not overlap(boxes[a], boxes[b]), (seed, a, b)
        for name, corners in boxes.items():
            assert corners[:, 1].min() == pytest.approx(PLACES[name][1] - 0.1, abs=1e-4)
        assert np.all(np.abs(boxes["OnTable"][:, [0, 2]] - (0.8, 0)) <= 0.4 + 0.013)
    assert moved == {"A", "OnTable"}  # B carries OnBox, which would lose a corner of its support


def test_furniture_keeps_clear_of_paths(room):
    way = ts.LinearWaypoints([ts.Waypoint((-0.6, 0.3, 0.5)), ts.Waypoint((-0.6, 0.3, 1.2))])
    scenario = Scenario(room, [ts.Object("ball", "Sphere", dynamic=way, scale=0.5)])
    for seed in range(8):
        corners = boxes_of(scenario.with_factor("furniture", {"shift": (0.0, 0.9)}, seed=seed))["A"]
        nearest = np.clip((-0.6, 0.3, 0.5), corners.min(0), corners.max(0))
        assert np.linalg.norm(nearest - (-0.6, 0.3, 0.5)) > 0.1


def test_furniture_variants_are_selected():
    scenario = Scenario("room_01").with_factor("furniture", {"variants": 1.0}, seed=3)
    assert scenario.variants["/Room01/Furniture/Chair{color}"] in ("chestnut", "oak", "walnut", "white")
    assert not any("lighting" in key or "appearance" in key for key in scenario.variants)


def test_clutter_rests_in_view_and_changes_no_motion(room):
    way = ts.LinearWaypoints([ts.Waypoint((-1, 0.6, 0.5)), ts.Waypoint((1, 0.6, 0.5))])
    scenario = Scenario(room, [ts.Object("ball", "Sphere", dynamic=way, scale=0.3)])
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


def test_clutter_that_fits_nowhere_raises(room):
    with pytest.raises(ScenarioError, match=r"'distractor_0' rests nowhere in view.*lower count or scale"):
        Scenario(room).with_factor("clutter", {"count": 1, "templates": ("Cup 01",), "scale": 90})


def test_views_turn_and_zoom_within_ranges(drawn):
    authored = stage_of(drawn).camera()
    for seed in range(6):
        turned = drawn.with_factor("views", {"yaw": (5, 10), "zoom": 2.0, "shift": (0.1, 0.3)}, seed=seed)
        (override,) = turned.overrides
        with ts.Stream(turned, width=8, height=6, buffers=("depth",)) as stream:
            camera = stream.world.camera
        cosine = float(camera.axes()[:, 2] @ authored.axes()[:, 2])
        assert 4.9 * np.cos(0.3) <= np.degrees(np.arccos(cosine)) <= 10.1
        assert np.tan(authored.vertical_fov / 2) / np.tan(camera.vertical_fov / 2) == pytest.approx(2.0, rel=1e-5)
        assert 0.1 <= np.linalg.norm(np.subtract(camera.position, authored.position)) <= 0.3001
        assert override.prim == ""
        assert camera.exposure == authored.exposure
    assert drawn.with_factor("views", "Left").camera == "Left"
    with pytest.raises(CameraNotFound):
        drawn.with_factor("views", "Lift")
    moving = replace(drawn, camera=ts.Camera(dynamic=ts.Orbit()))
    with pytest.raises(ScenarioError, match="moves along a trajectory"):
        moving.with_factor("views")


def test_rooms_and_occlusion_keep_templates_and_speeds(drawn):
    def speeds(scenario):
        result = []
        for each in scenario.objects:
            simulation, total = Simulation([Body(each.dynamic)]), faster_of(each)
            way = np.array([simulation.poses(total * k / 500)[0, :3] for k in range(501)])
            result.append(np.linalg.norm(np.diff(way, axis=0), axis=1).sum() / total)
        return result

    for other in (drawn.with_factor("rooms", "object_view", seed=1), drawn.with_factor("occlusion", 0.0, seed=1)):
        assert [each.template for each in other.objects] == [each.template for each in drawn.objects]
        np.testing.assert_allclose(speeds(other), speeds(drawn), rtol=2e-3)
        assert [each.position for each in other.objects] != [each.position for each in drawn.objects]
    with pytest.raises(SceneNotFound):
        drawn.with_factor("rooms", "nowhere")
    with pytest.raises(ScenarioError, match="rooms: the scenario has edits"):
        replace(drawn, edits=[Despawn(3, drawn.objects[0].id)]).with_factor("rooms", "object_view")


@pytest.mark.parametrize(
    ("factor", "value", "error", "message"),
    [
        ("ilumination", None, UnknownName, "no factor 'ilumination'. Did you mean 'illumination'"),
        ("illumination", "noon", ScenarioError, "has no lighting 'noon'; there are day, evening, night"),
        ("illumination", {"strenth": 1}, ArgumentError, "illumination: no such range 'strenth'; there are lighting, "),
        ("illumination", {"color": 2}, ArgumentError, r"illumination: color=2: must lie within 0\.\.1"),
        ("materials", "red", ArgumentError, "materials='red': must be True, or ranges by name: share, color"),
        ("speed", 0, ArgumentError, "speed=0"),
        ("clutter", {"count": 1.5}, ArgumentError, "whole numbers"),
        ("clutter", "many", ArgumentError, "clutter='many'"),
        ("clutter", {"count": 1, "templates": ("Nothing 01",)}, TemplateNotFound, "Nothing 01"),
        ("categories", ("unicorn",), ArgumentError, "no template has the category 'unicorn'"),
        ("occlusion", 1.5, ArgumentError, "occlusion=1.5"),
        ("views", {"zoom": 0}, ArgumentError, "views: zoom=0"),
    ],
)
def test_wrong_values_of_factors_raise(drawn, factor, value, error, message):
    with pytest.raises(error, match=message):
        drawn.with_factor(factor, value)
    with pytest.raises(ArgumentError, match="seed=-1"):
        drawn.with_factor("speed", seed=-1)


def test_mapping_changes_only_what_it_names():
    assert IlluminationRanges.of({"yaw": 3}, "illumination") == IlluminationRanges(yaw=(3, 3))


def test_materials_change_what_labels_and_color_show(drawn):
    """The buffer `albedo` shows overridden colors; labels stay."""
    painted = drawn.with_factor("materials", 0.6, seed=2)
    frames = []
    for scenario in (drawn, painted, replace(drawn, exposure_compensation=1.0)):
        with ts.Stream(scenario, width=32, height=24, buffers=("albedo", "instance"), quality="fast") as stream:
            frames.append((stream[0], stream.exposure))
    assert np.array_equal(frames[0][0].instance, frames[1][0].instance)
    assert np.abs(frames[0][0].albedo - frames[1][0].albedo).max() > 0.05
    assert frames[1][0].albedo.max() <= 0.9
    assert frames[2][1] == frames[0][1] + 1.0


def test_sample_reaches_a_band_of_difficulty_or_says_that_it_cannot(monkeypatch):
    ranges = {"seed": 1, "objects": 1, "templates": ("Ball 01",), "angular_speed": 0, "depth": (1, 2)}
    plain = Scenario.sample("object_view", **ranges)
    drawn = Scenario.sample("object_view", **ranges, difficulty={"motion": (3, 5), "size": (0, 1)})
    assert drawn == Scenario.sample("object_view", **ranges, difficulty={"motion": (3, 5), "size": (0, 1)})
    assert drawn.objects[0].dynamic.waypoints == plain.objects[0].dynamic.waypoints  # only its speed was changed
    with ts.Stream(drawn, width=128, height=96, buffers=("instance", "forward_flow")) as stream:
        motion = [stream[k * 250 // 8].difficulty.motion for k in range(8)]
    assert 3 <= np.mean(motion) <= 5
    monkeypatch.setattr("tiscene.randomization.difficulty_search.ATTEMPTS", 2)
    with pytest.raises(
        ScenarioError, match=r"none of 2 draws .*: instances was 1 to 1 in 2 of them, not within 5\.\.9"
    ):
        Scenario.sample("object_view", **ranges, difficulty={"instances": (5, 9)})
    for wrong, message in (
        ({"speed": 1}, "no measure 'speed'"),
        ({"size": (0, 2)}, r"within 0\.\.1"),
        ({}, "must map"),
    ):
        with pytest.raises(ArgumentError, match=message):
            Scenario.sample("object_view", **ranges, difficulty=wrong)


def test_lighting_is_that_of_the_scene_else_of_all_rooms(tmp_path):
    room = """
    def Xform "{name}" (
        variants = {{ string lighting = "day" }}
        prepend variantSets = "lighting"
    )
    {{
        variantSet "lighting" = {{ "day" {{ }} "night" {{ }} }}
    }}"""
    rooms = room.format(name="A") + room.format(name="B")
    joined = Scenario(str(write(tmp_path, f'def Xform "Home"\n{{{rooms}\n}}', name="home.usda")))
    assert joined.with_factor("illumination", "night").variants == {
        "/Home/A{lighting}": "night",
        "/Home/B{lighting}": "night",
    }
    whole = Scenario("home_01") if "home_01" in catalog.scenes() else Scenario("room_01")
    assert len(whole.with_factor("illumination", "night").variants) == 1
