# SPDX-License-Identifier: Apache-2.0
"""SAILenv's Agent in process: frames, edits, scenarios and errors."""

import math

import numpy as np
import pytest

import tiscene as ts
from tests.sailenv.conftest import HOME, SCENE, VIEWS, path
from tests.world.test_edit_costs import count_calls
from tiscene.errors import ArgumentError, ArgumentTypeError, ScenarioError, SceneNotFound, TemplateNotFound
from tiscene.sailenv import (
    Agent,
    AllTogetherTimings,
    CatmullWaypoints,
    DictTimings,
    FrameFlags,
    Object,
    Scenario,
    UniformMovementRandomBounce,
    Vector3,
    WaitUntilCompleteTimings,
)

START = (0.0, 0.2, -2.5)  # the start position in the object view


def center(mask):
    rows, columns = np.nonzero(mask)
    return columns.mean(), rows.mean()


def projected(x, y, z, width=64, height=48):
    """Pixel coordinates of a point before a camera at HOME: x right, y up, z ahead, vertical field of view 60°."""
    focal = 0.5 * height / math.tan(math.radians(30.0))
    return 0.5 * (width - 1) + focal * x / z, 0.5 * (height - 1) - focal * (y - 1.0) / z


def test_frame_has_all_views_in_their_types_and_sizes(make_agent):
    agent = make_agent()
    frame = agent.get_frame()
    assert set(frame) == {*VIEWS, "sizes", "deltaTime"}
    assert {name: (frame[name].dtype, frame[name].shape) for name in VIEWS} == {
        "main": (np.float32, (48, 64, 3)),
        "category": (np.uint8, (48, 64)),
        "object": (np.float32, (48, 64, 3)),
        "flow": (np.float32, (48, 64, 2)),
        "depth": (np.float32, (48, 64)),
    }
    assert frame["sizes"] == {"main": 9216, "category": 3072, "object": 9216, "flow": 24576, "depth": 3072}
    assert frame["deltaTime"] == pytest.approx(1 / 25)
    assert (frame["category"] == 255).all()
    assert not frame["object"].any()
    assert (frame["depth"] == 1.0).all()
    assert not frame["flow"].any()
    assert 0.0 < frame["main"].min() <= frame["main"].max() <= 1.0
    frame["flow"][:] = 1.0  # writable


def test_inactive_views_are_none(make_agent):
    agent = make_agent(main_frame_active=False, object_frame_active=False, depth_frame_active=False)
    assert agent.active_frames == {"main": False, "category": True, "object": False, "flow": True, "depth": False}
    assert agent.flags == FrameFlags.CATEGORY | FrameFlags.OPTICAL == 20
    frame = agent.get_frame()
    assert [name for name in VIEWS if frame[name] is not None] == ["category", "flow"]
    assert frame["sizes"] == {"main": 0, "category": 3072, "object": 0, "flow": 24576, "depth": 0}


def test_attributes_before_and_after_change_scene(make_agent):
    agent = make_agent()
    assert agent.id >= 0
    assert SCENE in agent.scenes
    assert agent.categories is agent.lights_names is agent.spawnable_objects_names is None
    agent.change_scene(SCENE)
    assert "cube" in agent.categories.values()
    assert 255 not in agent.categories
    assert agent.categories.keys() == agent.cat_colors.keys()
    assert all(len(color) == 3 and 0 <= min(color) <= max(color) <= 255 for color in agent.cat_colors.values())
    assert "Directional Light" in agent.lights_names
    assert {"Cube", "Chair 01", "Cube Trail", "Dish 01 Trail"} <= set(agent.spawnable_objects_names)
    assert agent.get_categories() == agent.categories
    assert tuple(agent.get_position()) == pytest.approx(START)
    assert agent.get_rotation() == Vector3(0, 0, 0)


def test_spawned_object_appears_at_its_unity_position(make_agent):
    agent = make_agent(main_frame_active=False)
    agent.get_categories()
    id = agent.spawn_object("Cube", (0.8, 1.4, 3.0), scale=(0.5, 0.5, 0.5))
    assert agent.spawned_objects_idstr_names_table == {id: "Cube"}
    frame = agent.get_frame()
    there = frame["object"].any(axis=-1)
    np.testing.assert_allclose(center(there), projected(0.8, 1.4, 3.0), atol=1.0)
    assert len(np.unique(frame["object"][there], axis=0)) == 1
    assert {agent.categories[number] for number in np.unique(frame["category"][there])} == {"cube"}
    assert (frame["category"][~there] == 255).all()
    steps = frame["depth"][there] * 255
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-4)
    assert 2.6 < (frame["depth"][there] * 15).min() < 3.0


@pytest.mark.parametrize(
    ("name", "width", "height", "by_scenario"),
    [("Cube", 1, 1, False), ("Cylinder", 1, 2, True), ("Sphere", 1, 1, True), ("Capsule", 1, 2, False)],
)
def test_primitives_have_sailenvs_sizes(make_agent, name, width, height, by_scenario):
    agent = make_agent(main_frame_active=False, width=128, height=96)
    if by_scenario:
        agent.load_scenario(Scenario(SCENE, [Object("a", name, (0, 1, 8), (0, 0, 0))]))
    else:
        agent.spawn_object(name, (0, 1, 16), scale=(2, 2, 2))
    frame = agent.get_frame()
    rows, columns = np.nonzero(frame["object"].any(axis=-1))
    focal = 0.5 * 96 / math.tan(math.radians(30.0)) / 7.75  # px per meter, between the front and the center
    assert np.ptp(columns) + 1 == pytest.approx(focal * width, abs=1.5)
    assert np.ptp(rows) + 1 == pytest.approx(focal * height, abs=1.5)
    if by_scenario:
        assert 15.0 * frame["depth"].min() == pytest.approx(7.5, abs=0.1)


def test_flow_is_minus_dx_and_plus_dy(make_agent):
    """(dx, dy) is the motion of a point in the image since the frame before, px, y down."""
    agent = make_agent(main_frame_active=False)
    move = path((-0.4, 0.8, 3.0), (0.4, 1.6, 3.0))
    agent.load_scenario(Scenario(SCENE, [Object("s", "Sphere", HOME, HOME, move)], AllTogetherTimings(0.0)))
    for _ in range(10):
        frame = agent.get_frame()
    there = frame["object"].any(axis=-1)
    ahead = 15.0 * np.median(frame["depth"][there])  # of the visible side of the sphere
    at = [np.array(projected(-0.4 + 0.4 * k / 25, 0.8 + 0.4 * k / 25, ahead)) for k in (8, 9)]
    dx, dy = at[1] - at[0]
    assert dx > 0.1
    assert dy < -0.1
    np.testing.assert_allclose(np.median(frame["flow"][there], axis=0), (-dx, dy), rtol=0.1)
    assert not frame["flow"][~there].any()
    empty = np.s_[:6, 40:]
    agent.set_position((0.1, 1.0, 0.0))
    assert not agent.get_frame()["flow"][empty].any()  # the background is at infinity
    agent.set_rotation((0, 1, 0))  # the image moves left
    assert (agent.get_frame()["flow"][empty][..., 0] > 0.1).all()


def test_spawned_objects_can_be_moved_and_despawned(make_agent):
    agent = make_agent(main_frame_active=False)
    first = agent.spawn_object("Cube", (-0.8, 1, 3))
    other = agent.spawn_object("Cube Trail", Vector3(0.8, 1, 3), dynamic=path((0.8, 1, 3), (0.8, 2, 3)))
    colors = np.unique(agent.get_frame()["object"].reshape(-1, 3), axis=0)
    assert len(colors) == 3
    agent.move_object(first, (-0.8, 1.3, 3), (0, 0, 45))
    moved = agent.get_frame()
    left = moved["object"][:, :32].any(axis=-1)
    assert center(left)[1] == pytest.approx(projected(-0.8, 1.3, 3)[1], abs=1.0)
    assert not moved["object"][0].any()
    agent.despawn_object(first)
    assert agent.spawned_objects_idstr_names_table == {other: "Cube Trail"}
    assert not agent.get_frame()["object"][:, :32].any()


def test_spawns_make_as_many_calls_after_150_edits_as_after_10(make_agent):
    agent = make_agent(main_frame_active=False)

    def cycle():
        spawned = agent.spawn_object("Cube", (0.0, 1.0, 3.0))
        agent.get_frame()
        agent.despawn_object(spawned)
        agent.get_frame()

    calls = [count_calls(cycle) if number in (5, 75) else cycle() for number in range(76)]
    assert calls[75] < 1.1 * calls[5]


def test_spawn_object_accepts_the_signatures_of_all_versions(make_agent):
    """(dynamic, remove, limited, scale, parent); in 2021 without `limited`, in 2020 also without `dynamic`."""
    agent = make_agent(main_frame_active=False, category_frame_active=False, flow_frame_active=False)
    calls = (
        ((None, True, True, (2, 2, 2), True), {}),
        ((None, True, (2, 2, 2), True), {}),
        ((True, (2, 2, 2), True), {}),
        ((), {"remove_dynamics": False, "scale": (2, 2, 2)}),
        ((True,), {"scale": (2, 2, 2), "use_parent": False}),
    )
    seen = []
    for positional, named in calls:
        id = agent.spawn_object("Cube", (0, 1, 4), (0, 0, 0), *positional, **named)
        seen.append(agent.get_frame()["depth"].tobytes())
        agent.despawn_object(id)
    assert set(seen) == {seen[0]}
    agent.spawn_object("Cube", (0, 1, 4), (0, 0, 0), True)
    assert agent.get_frame()["depth"].tobytes() != seen[0]


@pytest.mark.parametrize(("walls", "frustum"), [(True, ts.Frustum()), (False, None)])
def test_load_scenario_accepts_the_frustum_key_of_early_clients(make_agent, walls, frustum):
    agent = make_agent()
    environment = agent.environment
    content = {"scene_name": SCENE, "objects": [], "spawn_frustum": walls}
    environment.load_scenario(environment.agents[agent.id], content)
    assert environment.stream.scenario.frustum == frustum


def test_views_are_the_buffers_of_a_stream_of_the_same_scenario(make_agent):
    agent = make_agent(seed=3, denoise=False)
    bounce = UniformMovementRandomBounce((1, 0.5, 0), 0.5, 1.0, 9)
    objects = [
        Object("a", "Chair 01", Vector3(0.4, 0.8, 3), Vector3(0, 30, 0), bounce),
        Object("b", "Dish 01", Vector3(0, 0, 0), Vector3(0, 0, 0), path((-0.5, 1, 2), (0, 1.3, 3))),
    ]
    ids = agent.load_scenario(Scenario(SCENE, objects, AllTogetherTimings(0.0)))
    assert [name for _, name in ids] == ["a", "b"]
    assert agent.spawned_objects_idstr_names_table == dict(ids)
    start = ts.Stream("object_view", width=8, height=8).world.camera
    native = ts.Scenario(
        "object_view",
        [
            ts.Object(
                "a",
                "Chair 01",
                (0.4, 0.8, -3),
                (0, -30, 0),
                ts.UniformMovementRandomBounce(speed=0.5, angular_speed=1.0, start_direction=(1, 0.5, 0), seed=9),
            ),
            ts.Object(
                "b", "Dish 01", dynamic=ts.LinearWaypoints([ts.Waypoint((-0.5, 1, -2)), ts.Waypoint((0, 1.3, -3))], 4.0)
            ),
        ],
        camera=ts.Camera(position=(0, 1, 0), exposure=start.exposure),
    )
    buffers = ("rgb", "instance", "depth", "backward_flow")
    settings = {"quality": "preview", "spp": 1, "denoise": False}
    stream = ts.Stream(native, width=64, height=48, seed=3, buffers=buffers, **settings)
    stream.world.turn_camera()  # like an agent's, a camera that was placed is seen over a panorama
    for _, frame in zip(range(3), stream, strict=False):
        seen = agent.get_frame()
        there = frame.instance > 0
        inside = there & np.roll(there, 1, 0) & np.roll(there, -1, 0) & np.roll(there, 1, 1) & np.roll(there, -1, 1)
        np.testing.assert_array_equal(np.rint(seen["main"] * 255)[inside], frame.rgb[inside])
        np.testing.assert_array_equal(seen["object"].any(axis=-1), frame.instance > 0)
        np.testing.assert_array_equal(seen["flow"], frame.backward_flow * (1, -1))
        np.testing.assert_array_equal(np.rint(seen["depth"] * 255), np.rint(np.minimum(frame.depth / 15, 1) * 255))
    assert {row.id for row in frame.objects} == {int(id) for id, _ in ids}


def test_same_calls_give_the_same_bytes(make_agent):
    def run(port):
        agent = make_agent(port=port)
        agent.load_scenario(Scenario(SCENE, [Object("a", "Cube", (0, 1, 3), HOME, UniformMovementRandomBounce())]))
        frames = [agent.get_frame() for _ in range(2)]
        agent.spawn_object("Sphere", (0.5, 1, 2))
        agent.toggle_follow()
        return frames + [agent.get_frame() for _ in range(3)]

    for here, there in zip(run(1), run(2), strict=True):
        for name in VIEWS:
            assert here[name].tobytes() == there[name].tobytes()


def test_agents_of_one_world_share_objects_and_the_frame_clock(make_agent):
    one, two = make_agent(main_frame_active=False), make_agent(main_frame_active=False, width=32, height=24)
    assert one.id != two.id
    one.spawn_object("Cube", (0, 1, 3))
    one.load_scenario(
        Scenario(SCENE, [Object("a", "Cube", HOME, HOME, path((0, 1, 3), (1, 1, 3)))], AllTogetherTimings(0.0))
    )
    for _ in range(3):
        first, second = one.get_frame(), two.get_frame()
        assert first["deltaTime"] == second["deltaTime"] == pytest.approx(0.04)
        np.testing.assert_array_equal(np.unique(first["object"]), np.unique(second["object"]))
    for _ in range(5):
        one.get_frame()
    late = two.get_frame()  # the current frame, not the next of those it has missed
    assert late["deltaTime"] == pytest.approx(5 * 0.04)
    two.spawn_object("Sphere", (0, 1, 2))
    assert len(np.unique(two.get_frame()["object"].reshape(-1, 3), axis=0)) == 3
    assert len(np.unique(one.get_frame()["object"].reshape(-1, 3), axis=0)) == 3
    two.set_position((0, 1, -5))
    assert one.get_position() == Vector3(*HOME)


def test_errors_are_printed_or_raised_if_strict(make_agent, capsys):
    agent = make_agent()
    agent.change_scene(SCENE)
    agent.change_scene("object_veiw/scene")
    assert "Did you mean 'object_view/scene'?" in capsys.readouterr().out
    assert agent.spawn_object("Chair 1") == ""
    assert "Chair 01" in capsys.readouterr().out
    agent.despawn_object("77")
    agent.move_object("77", (0, 0, 0), (0, 0, 0))
    agent.set_position((1, 2))
    agent.set_rotation((float("nan"), 0, 0))
    assert agent.get_light_color("No Light") is None
    assert agent.get_light_type("No Light") is None
    agent.set_light_intensity("No Light", 1.0)
    assert agent.spawn_object("Cube", dynamic=CatmullWaypoints([])) == ""
    assert len(capsys.readouterr().out.splitlines()) == 8
    light, nan, inf = agent.lights_names[0], float("nan"), float("inf")
    before = agent.get_light_position(light), agent.get_light_direction(light), agent.get_light_color(light)
    agent.set_light_position(light, (nan, 0, 0))
    agent.set_light_direction(light, (inf, 0, 0))
    agent.set_light_color(light, "red", 0, 0)
    agent.set_light_intensity(light, 1e38)
    agent.set_light_indirect_multiplier(light, nan)
    agent.set_ambient_light_color(nan, 0, 0)
    agent.change_main_camera_clear_flags("a", 0, 0)
    assert agent.get_light_color(3) is None
    assert agent.spawn_object(3) == ""
    agent.despawn_object(inf)
    assert len(capsys.readouterr().out.splitlines()) == 10
    now = agent.get_light_position(light), agent.get_light_direction(light), agent.get_light_color(light)
    assert now == before
    strict = make_agent(strict=True)
    with pytest.raises(SceneNotFound):
        strict.change_scene("nowhere")
    with pytest.raises(SceneNotFound, match=r"is a scene once it is NAME/scene\.usda in a folder of TISCENE_PATH"):
        strict.change_scene("my/kitchen.usda")
    with pytest.raises(TemplateNotFound):
        strict.spawn_object("Nothing")
    with pytest.raises(ArgumentError, match="register"):
        Agent().get_frame()
    with pytest.raises(ArgumentError, match="qualty: Agent has no such argument; did you mean 'quality'"):
        Agent(qualty="fast")


@pytest.mark.parametrize(
    ("method", "arguments", "message"),
    [
        ("spawn_object", ("Cube", HOME, HOME, "still"), "dynamic='still': must be a Dynamic of SAILenv, such as"),
        ("spawn_object", ("Cube", HOME, HOME, CatmullWaypoints(object())), "CatmullWaypoints.waypoints=<obj"),
        ("set_position", (None,), "^None: must be three numbers x, y, z$"),
        ("set_light_intensity", ("Main Light", "bright"), "'bright': must be a number$"),
        ("set_light_indirect_multiplier", ("Main Light", [1, 2]), r"\[1, 2\]: must be a number$"),
        ("despawn_object", ([],), r"object id=\[\]: must be an integer"),
        ("load_scenario", ("scene.json",), "scenario='scene.json': must be a Scenario whose `objects` are a list of"),
        ("load_scenario", (Scenario(SCENE, None),), "must be a Scenario whose `objects` are a list of Object"),
        ("load_scenario", (Scenario(SCENE, [{"id": "a"}]),), "must be a Scenario whose `objects` are a list of Object"),
        ("load_scenario", (Scenario(SCENE, [], AllTogetherTimings(object())),), "AllTogetherTimings.wait_time=<obj"),
    ],
)
def test_arguments_of_wrong_types_are_errors_of_tiscene(make_agent, capsys, method, arguments, message):
    agent = make_agent()
    getattr(agent, method)(*arguments)
    assert len(capsys.readouterr().out.splitlines()) == 1
    agent.strict = True
    with pytest.raises((ArgumentError, ScenarioError), match=message):
        getattr(agent, method)(*arguments)


def test_sizes_ports_and_files_of_wrong_types_are_refused(make_agent):
    for name, value in (("width", "wide"), ("height", None), ("port", math.inf)):
        with pytest.raises(ArgumentTypeError, match=f"{name}={value!r}: must be an integer"):
            Agent(**{name: value}).register()
    agent = make_agent()
    with pytest.raises(ArgumentTypeError, match="file=3: must be a path, or a file open for reading"):
        agent.send_obj_zip(3, "model.zip")
    with pytest.raises(ArgumentTypeError, match="filename=3: must be a string"):
        agent.send_obj_zip(__file__, 3)


def test_printed_errors_repeat_names_with_braces(make_agent, capsys):
    agent = make_agent()
    for call in (agent.spawn_object, agent.despawn_object, agent.change_scene, agent.get_light_color):
        call("{x}{}")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert all("{x}{}" in line for line in lines)


def test_agent_that_registers_again_is_in_the_worlds_once(make_agent):
    agent, other = make_agent(), make_agent()
    worlds = agent._worlds
    for _ in range(2):
        agent.register()
    assert worlds.agents.keys() == {agent.id, other.id}
    agent.delete()
    assert worlds.agents.keys() == {other.id}


def test_load_scenario_skips_invalid_objects_and_rejects_invalid_scenarios(make_agent, capsys):
    agent = make_agent(main_frame_active=False)
    objects = [
        Object("a", "Nothing", (0, 1, 3), HOME),
        Object("b", "Cube", (0, 1, 3), HOME, path((0, 1, 3), (1, 1, 3))),
        Object("c", "Sphere", (0, 1, 3), HOME, path((1, 1, 3), (1, 2, 3))),
    ]
    (a, _), (b, _), (c, name) = agent.load_scenario(Scenario(SCENE, objects, DictTimings({0: 1.0, 1: 2.0, "c": 3.0})))
    assert (a, name) == ("", "c")
    assert "" not in (b, c)
    assert "Nothing" in capsys.readouterr().out
    before = agent.get_frame()["object"]
    endless = Scenario(
        SCENE, [Object("d", "Cube", HOME, HOME, UniformMovementRandomBounce())], WaitUntilCompleteTimings(1.0)
    )
    assert agent.load_scenario(endless) == [("", "d")]
    assert "never returns" in capsys.readouterr().out
    np.testing.assert_array_equal(agent.get_frame()["object"].any(), before.any())  # the old scenario continues
