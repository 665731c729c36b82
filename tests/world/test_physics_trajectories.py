# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies of a scenario: on the stage, beside movers, spawned and moved while a stream runs."""

import sys
from fractions import Fraction

import numpy as np
import pytest

pytest.importorskip("mujoco")

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import MissingExtra, ScenarioError, StageWarning
from tiscene.scenario.edits import SetFrustumWalls, Spawn
from tiscene.usd.joining.box_cut import cut_box
from tiscene.world.physics.convex_parts import convex_parts

CAMERA = ts.Camera.look_at((0.0, 1.2, 4.0), (0.0, 0.6, 0.0), (0.0, 1.0, 0.0))
BUFFERS = ("instance", "depth", "backward_flow")


@pytest.fixture(scope="module")
def stream():
    """A cube that falls on a floor, a thrown ball, and a cube that stays, where there is no stage."""
    objects = [
        ts.Object("cube", "Cube", (0.0, 0.9, 0.0)),
        ts.Object("ball", "Ball 01", (-0.8, 1.0, 0.3), first_frame=5, dynamic=ts.RigidBody(velocity=(1.0, 1.0, 0.0))),
        ts.Object("fixed", "Cube", (0.9, 1.4, 0.0), dynamic=ts.Still()),
        ts.Object("floor", "Cube", (0.0, -1.0, 0.0), scale=(25.0, 5.0, 25.0), dynamic=ts.Still()),
    ]
    return ts.Stream(
        ts.Scenario("object_view", objects, physics=True, camera=CAMERA), width=24, height=18, buffers=BUFFERS
    )


def height(stream, frame, name):
    return next(row.position[1] for row in stream.world.state(frame).objects if row.name == name)


def test_objects_fall_and_rest(stream):
    assert height(stream, 5, "cube") == pytest.approx(0.9 - 0.5 * 9.81 * 0.2**2, abs=1e-9)
    assert height(stream, 60, "cube") == pytest.approx(0.2, abs=2e-3)
    assert height(stream, 10, "ball") == pytest.approx(1.0 + 0.2 - 0.5 * 9.81 * 0.2**2, abs=1e-9)
    assert height(stream, 60, "fixed") == 1.4


def test_seek_returns_the_frames_of_playing_in_another_stream(stream):
    played = [stream[frame] for frame in range(30)]
    sought = ts.Stream(stream.scenario, width=24, height=18, buffers=BUFFERS)
    for frame in (29, 4, 12, 11, 28):
        for name in BUFFERS:
            assert sought[frame][name].tobytes() == played[frame][name].tobytes()


def test_flow_is_that_of_the_fall(stream):
    frame = stream[8]
    rows = {row.name: row.id for row in frame.objects}
    there = frame.instance == rows["cube"]
    assert there.any()
    assert (frame.backward_flow[there][:, 1] < 0.0).all()  # it was higher before


def test_new_contacts_are_reported(stream):
    found = [(frame, event) for frame in range(40) for event in stream[frame].events if event.kind == "contact"]
    row = {each.name: each.id for each in stream[6].objects}
    touched = [frame for frame, event in found if {event.object, event.other} == {row["cube"], row["floor"]}]
    assert touched
    assert 8 <= touched[0] <= 12  # after 0.5 s of fall
    assert len(touched) < 6


def test_object_rests_on_the_stage():
    objects = [ts.Object("cube", "Cube", (0.0, 0.6, 0.0))]
    stream = ts.Stream(ts.Scenario("solid_benchmark", objects, physics=True), width=8, height=6, buffers=("depth",))
    assert height(stream, 40, "cube") == pytest.approx(0.2, abs=2e-3)
    contacts = {each.kind for each in stream.world.trajectories.collisions(10)}
    assert contacts <= {"stage", "collider"}


def test_edits_show_in_later_frames_and_replay(stream):
    edited = ts.Stream(stream.scenario, width=24, height=18, buffers=BUFFERS)
    for _ in range(6):
        next(edited)
    edited.world.spawn("Ball 01", (0.0, 2.0, 0.0), id="second")
    edited.world.move("cube", (0.0, 1.5, 0.5))
    frames = [next(edited) for _ in range(12)]
    assert height(edited, 6, "cube") == 1.5
    assert height(edited, 10, "second") == pytest.approx(2.0 - 0.5 * 9.81 * (4 / 25) ** 2, abs=1e-9)
    replayed = ts.Stream(ts.Scenario.from_json(edited.scenario.to_json()), width=24, height=18, buffers=BUFFERS)
    for frame in reversed(frames):
        assert replayed[frame.index].depth.tobytes() == frame.depth.tobytes()


def test_timings_that_wait_for_loops_accept_rigid_bodies():
    loop = ts.LinearWaypoints([ts.Waypoint((0, 1, 0)), ts.Waypoint((1, 1, 0))], total_time=1.0)
    objects = [ts.Object("a", "Cube", dynamic=loop), ts.Object("b", "Cube", (0, 3, 0))]
    scenario = ts.Scenario("solid_benchmark", objects, ts.WaitUntilComplete(0.0), physics=True)
    assert scenario.objects[1].dynamic == ts.RigidBody()
    assert ts.Scenario.from_json(scenario.to_json()) == scenario


@pytest.mark.parametrize(
    "named", [{"density": 0.0}, {"friction": -1.0}, {"restitution": 1.0}, {"velocity": (1, 2)}, {"density": "heavy"}]
)
def test_invalid_rigid_bodies_are_errors(named):
    with pytest.raises(ts.TisceneError):
        ts.Object("a", "Cube", dynamic=ts.RigidBody(**named))


def grid_box(low, high):
    """Return the twelve triangles of a box, counter-clockwise from outside."""
    import trimesh

    return np.asarray(trimesh.creation.box(bounds=[low, high]).triangles, np.float64)


def covers(parts, point):
    """Return whether a point is in one of the parts."""
    from scipy.spatial import ConvexHull

    return any((ConvexHull(part.points).equations @ np.array([*point, 1.0]) <= 1e-9).all() for part in parts)


def test_convex_surface_is_one_part_and_separate_ones_are_several():
    one = convex_parts(grid_box((-1, -1, -1), (1, 1, 1)), 0.01, 0.005)
    assert [(part.kind, part.half.tolist()) for part in one] == [("box", [1, 1, 1])]
    both = np.concatenate([grid_box((0, 0, 0), (1, 0.1, 1)), grid_box((0.2, 0.2, 0.2), (0.3, 1, 0.3))])
    assert len(convex_parts(both, 0.01, 0.005)) == 2


def test_bowl_is_covered_by_parts_that_leave_its_inside_free():
    import trimesh

    profile = [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.46, 0.5), (0.46, 0.04), (0.0, 0.04)]
    surface = np.asarray(trimesh.creation.revolve(np.array(profile), sections=48).triangles, np.float64)
    surface = surface[:, :, [0, 2, 1]][:, ::-1]
    parts = convex_parts(surface, 0.01, 0.005)
    assert 4 < len(parts) < 300
    assert not any(covers(parts, point) for point in ((0.0, 0.3, 0.0), (0.3, 0.2, 0.2)))
    assert all(covers(parts, point) for point in ((0.0, 0.02, 0.0), (0.3, 0.02, 0.2), (0.48, 0.3, 0.0)))


@pytest.mark.parametrize("more", [[], [((2, 0, -0.1), (2.2, 3, 4))]], ids=["alone", "beside another wall"])
def test_doorway_in_a_hollow_wall_stays_open(more):
    """As `tiscene.usd.join` cuts it: the faces of the wall end at the doorway, and nothing closes the cut."""
    points = np.concatenate([grid_box(*bounds) for bounds in [((-2, 0, -0.1), (2, 3, 0.1)), *more]]).reshape(-1, 3)
    counts = np.full(len(points) // 3, 3)
    left = cut_box((points - (0, 1, 0)) / (0.45, 1.0, 0.2), counts, np.arange(len(points)))
    corners = left.blend(points)
    polygons = np.split(corners, np.cumsum(left.counts)[:-1])
    triangles = [each[[0, k, k + 1]] for each in polygons for k in range(1, len(each) - 1)]
    parts = convex_parts(np.array(triangles), 0.02, 0.03)
    assert not any(covers(parts, (x, y, 0.0)) for x in (-0.4, 0.0, 0.4) for y in (0.05, 1.0, 1.9))
    assert all(covers(parts, (x, y, z)) for z in (-0.09, 0.09) for x, y in ((-1.0, 1.0), (1.0, 1.0), (0.0, 2.5)))


def test_skirting_around_a_floor_leaves_the_floor_free():
    import trimesh

    ring = np.asarray(trimesh.creation.annulus(r_min=0.9, r_max=1.0, height=0.035).triangles, np.float64)
    parts = convex_parts(ring, 0.02, 0.03)
    assert not covers(parts, (0.0, 0.0, 0.0))
    assert covers(parts, (0.95, 0.02, 0.0))


def test_thin_plate_with_a_hole_stays_open():
    frame = [((0, 0, 0), (3, 0, 1)), ((0, 0, 2), (3, 0, 3)), ((0, 0, 1), (1, 0, 2)), ((2, 0, 1), (3, 0, 2))]
    quads = []
    for (x0, _, z0), (x1, _, z1) in frame:
        a, b, c, d = (x0, 0, z0), (x0, 0, z1), (x1, 0, z1), (x1, 0, z0)
        quads += [(a, b, c), (a, c, d)]
    parts = convex_parts(np.array(quads, np.float64), 0.02, 0.03)
    for part in parts:
        low, high = part.points.min(axis=0), part.points.max(axis=0)
        assert not ((low[[0, 2]] < 1.4).all() and (high[[0, 2]] > 1.6).all())
        assert high[1] == pytest.approx(0.0, abs=1e-9)  # the plate grows at its back, downwards
        assert low[1] == pytest.approx(-0.03, abs=1e-9)


def test_a_pile_of_concave_objects_rests_on_the_floor():
    """Its contacts take more memory than the engine sets aside by itself; without them it would fall."""
    from mujoco import mjtWarning

    floor = ts.Object("floor", "Cube", (0.0, -1.0, 0.0), scale=(25.0, 5.0, 25.0), dynamic=ts.Still())
    tori = [ts.Object(f"torus_{k}", "Torus", (0.02 * k, 0.3 + 0.02 * k, 0.0)) for k in range(3)]
    scenario = ts.Scenario("object_view", [floor, *tori], physics=True)
    with ts.Stream(scenario, width=8, height=6, buffers=("depth",)) as stream:
        assert height(stream, 25, "torus_0") > 0.0
        (model,) = stream.world.trajectories._physics._models._values.values()
        assert model._data.warning[mjtWarning.mjWARN_CNSTRFULL].number == 0


@pytest.mark.parametrize(("template", "scale"), [("Ball 01", 0.001), ("Cup 01", 0.03)])
def test_objects_that_are_too_small_are_named(template, scale, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where the engine would write its log
    floor = ts.Object("floor", "Cube", (0.0, -1.0, 0.0), scale=(25.0, 5.0, 25.0), dynamic=ts.Still())
    grain = ts.Object("grain", template, (0.0, 0.1, 0.0), (10, 20, 5), scale=scale)
    stream = ts.Stream(ts.Scenario("object_view", [floor, grain], physics=True), width=8, height=6)
    with pytest.raises(ScenarioError, match="object 'grain' is too small"):
        stream.world.state(60)
    assert list(tmp_path.iterdir()) == []


def test_bodies_fall_freely_within_the_walls_of_a_frustum():
    """They were flung towards the camera: the walls began at the origin of the world."""
    ball = ts.Object("ball", "Ball 01", (0.0, 1.0, -3.0), dynamic=ts.RigidBody())
    spawned = ts.Object("later", "Ball 01", (0.5, 1.0, -3.0), dynamic=ts.RigidBody(), first_frame=3)
    scenario = ts.Scenario("object_view", [ball], frustum=ts.Frustum(6.0), edits=[Spawn(3, spawned)])
    world = ts.Stream(scenario, width=8, height=6, buffers=("depth",)).world
    for frame in (1, 5):
        for row in world.state(frame).objects:
            if row.name in ("ball", "later"):
                time = (frame - (3 if row.name == "later" else 0)) / 25.0
                x = 0.5 if row.name == "later" else 0.0
                np.testing.assert_allclose(row.position, (x, 1.0 - 4.905 * time**2, -3.0), atol=1e-8)


def test_walls_that_an_edit_places_hold_bodies_at_once_and_pull_them_in():
    """Bodies passed through them for a frame, and were flung back at 60 m/s."""
    start, beside = (0.0, 50.0, -6.0), (-0.6, 50.0, -6.0)
    resting = ts.Object("resting", "Ball 01", beside, dynamic=ts.RigidBody(starts_asleep=True))
    spawned = ts.Object("spawned", "Ball 01", start, dynamic=ts.RigidBody(), first_frame=3)
    thrown = ts.Object(
        "thrown", "Ball 01", (0.5, 50.0, -3.0), dynamic=ts.RigidBody(velocity=(0, 0, -30)), first_frame=3
    )
    camera = ts.Camera((0.0, 50.0, 0.0))
    walls = SetFrustumWalls(3, ts.Frustum(4.0), camera, 4.0 / 3.0)
    scenario = ts.Scenario("object_view", [resting], camera=camera, edits=[walls, Spawn(3, spawned), Spawn(3, thrown)])
    world = ts.Stream(scenario, width=8, height=6, buffers=("depth",)).world
    for frame in range(4, 8):
        rows = {row.name: row for row in world.state(frame).objects}
        for name in ("resting", "spawned", "thrown"):
            assert -4.0 < rows[name].position[2] < -2.0
            assert np.linalg.norm(rows[name].velocity) < (30.0 if name == "thrown" else 3.0)


def test_objects_that_are_too_large_are_named():
    floor = ts.Object("floor", "Cube", (0.0, -1.0, 0.0), scale=1e7, dynamic=ts.Still())
    ball = ts.Object("ball", "Ball 01", (0.0, 0.1, 0.0))
    stream = ts.Stream(ts.Scenario("object_view", [floor, ball], physics=True), width=8, height=6)
    with pytest.raises(ScenarioError, match=r"object 'floor' is 4e\+06 m large: .* larger than 100000 m"):
        stream.world.state(1)


def test_missing_engine_is_named_at_once(monkeypatch):
    """It was named at the next frame, when the spawned object was part of the scenario already."""
    stream = ts.Stream("object_view", width=8, height=6, buffers=("depth",))
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtra, match=r"tiscene\[physics\]"):
        stream.world.spawn("Cube", (0, 1, 0), dynamic=ts.RigidBody())
    assert stream.scenario.edits == ()
    next(stream)
    with pytest.raises(MissingExtra, match=r"tiscene\[physics\]"):
        ts.Stream(ts.Scenario("object_view", [ts.Object("a", "Cube")], physics=True), width=8, height=6)


def test_edit_of_the_next_frame_is_not_anticipated_by_the_shutter():
    scenario = ts.Scenario("object_view", [ts.Object("cube", "Cube", (0.0, 0.9, 0.0))], physics=True, camera=CAMERA)
    world = ts.Stream(scenario, width=8, height=6, buffers=("depth",)).world
    before = world.between(7, Fraction(1))[0].world_from_object.tobytes()
    world.next_frame = 8
    world.move("cube", (0.5, 2.0, 0.0))
    assert world.between(7, Fraction(1))[0].world_from_object.tobytes() == before


MOON = """
def PhysicsScene "Physics" {{
    {gravity}
}}
def Cube "Box" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {{
    double size = 20
}}
"""


@pytest.mark.parametrize(
    ("gravity", "expected"),
    [
        ("", (0, 0, -9.81)),
        ("float physics:gravityMagnitude = 981", (0, 0, -9.81)),
        ("float physics:gravityMagnitude = 162", (0, 0, -1.62)),
        ("vector3f physics:gravityDirection = (2, 0, 0)", (9.81, 0, 0)),
        ("float physics:gravityMagnitude = 0", (0, 0, 0)),
        ("float physics:gravityMagnitude = -5", (0, 0, -9.81)),
    ],
)
def test_rigid_body_falls_by_the_gravity_of_the_stage(tmp_path, gravity, expected):
    path = write(tmp_path, MOON.format(gravity=gravity), meters=0.01, up="Z")
    stream = ts.Stream(path, width=8, height=6, buffers=("instance",), fps=50)
    (box,) = stream.world.state(10).objects
    assert box.position == pytest.approx([0.5 * each * 0.2**2 for each in expected], abs=1e-9)


@pytest.mark.parametrize(
    ("gravity", "fault", "expected"),
    [
        ("float physics:gravityMagnitude = inf", "gravityMagnitude is inf", (0, 0, -9.81)),
        ("float physics:gravityMagnitude = nan", "gravityMagnitude is nan", (0, 0, -9.81)),
        (
            "float physics:gravityMagnitude = 162\nvector3f physics:gravityDirection = (nan, 0, 0)",
            r"gravityDirection is \(nan, 0.0, 0.0\)",
            (0, 0, -1.62),
        ),
    ],
)
def test_gravity_that_is_not_finite_is_named(tmp_path, gravity, fault, expected):
    path = write(tmp_path, MOON.format(gravity=gravity), meters=0.01, up="Z")
    with pytest.warns(StageWarning, match=f"{fault}, which is not finite: .* used: </Physics>"):
        stream = ts.Stream(path, width=8, height=6, buffers=("instance",), fps=50)
    (box,) = stream.world.state(10).objects
    assert box.position == pytest.approx([0.5 * each * 0.2**2 for each in expected], abs=1e-9)
