# SPDX-License-Identifier: Apache-2.0
"""Overrides of a stage: lights, materials, objects and cameras differ from frame 0 on, at no cost per frame."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import tiscene as ts
from tests.world.test_collisions import CUBE, TEMPLATE, at, mesh
from tiscene.errors import CameraNotFound, LightNotFound, MaterialNotFound, ObjectNotFound, ScenarioError, StageWarning
from tiscene.scenario.overrides import CameraOverride, LightOverride, MaterialOverride, ObjectOverride
from tiscene.scene.animation import InstanceTrack
from tiscene.scene.description import (
    Collider,
    DistantLight,
    Instance,
    Material,
    SceneDescription,
    SceneObject,
    SphereLight,
    TextureLookup,
)
from tiscene.world.overridden_stage import overridden
from tiscene.world.world import World

STAGE = SceneDescription(
    "room",
    (mesh(CUBE),),
    materials=(
        Material("Oak", (0.2, 0.4, 0.6), prim_path="/Looks/Oak"),
        Material("Cloth", TextureLookup(0), roughness=0.9, prim_path="/Looks/Cloth"),
    ),
    instances=(Instance(0, 0, at(5, 0, 0)), Instance(0, 1, at(0, 0, 0)), Instance(0, 0, at(5, 2, 0))),
    objects=(SceneObject("Lamp", "/Lamp", "lamp"), SceneObject("Box", "/Box", "box")),
    lights=(
        SphereLight("Bulb", "/Lamp/Bulb", at(5, 1, 0), (8.0, 8.0, 8.0), 0.1),
        DistantLight("Sun", "/Sun", np.eye(4), irradiance=(2.0, 4.0, 6.0)),
    ),
    cameras=(ts.Camera(name="Door", exposure=3.0), ts.Camera(name="Window", position=(1, 2, 3))),
    colliders=(Collider(0, 0, at(5, -1, 0)),),
)


def load(name):
    return replace(TEMPLATE, description=replace(TEMPLATE.description, materials=(PAINT,)))


PAINT = Material("Paint", (0.5, 0.5, 0.5), prim_path="Cube/Looks/Paint")


def world(*overrides, objects=()):
    return World(ts.Scenario("room", objects, overrides=overrides), STAGE, load, 25.0)


def test_stage_without_overrides_is_the_same_object():
    assert overridden(STAGE, ()) is STAGE


def test_light_override_multiplies_radiance_and_turns_the_light():
    bulb, sun = overridden(STAGE, [LightOverride("Sun", 0.5, (1, 2, 0), pitch=-90)]).lights
    assert bulb is STAGE.lights[0]
    assert sun.irradiance == (1.0, 4.0, 0.0)
    np.testing.assert_allclose(-sun.world_from_light[:3, 2], (0, -1, 0), atol=1e-12)  # light travels down
    _, sun = overridden(STAGE, [LightOverride("/Sun", yaw=90)]).lights
    np.testing.assert_allclose(-sun.world_from_light[:3, 2], (-1, 0, 0), atol=1e-12)


@pytest.mark.parametrize(
    ("pair", "message"),
    [
        ((LightOverride("Sun", 0.5), LightOverride("/Sun", 0.2)), "two LightOverrides of '/Sun': 'Sun' and '/Sun'"),
        ((ObjectOverride("/Box", (1, 0, 0)), ObjectOverride("Box")), "two ObjectOverrides of '/Box'"),
        ((CameraOverride("", vertical_fov=0.5), CameraOverride("Door")), "two CameraOverrides of 'Door'"),
    ],
)
def test_two_overrides_of_one_prim_are_refused(pair, message):
    with pytest.raises(ScenarioError, match=message):
        overridden(STAGE, pair)
    assert overridden(STAGE, (LightOverride("Sun"), LightOverride("/Lamp/Bulb"), ObjectOverride("Box", (1, 0, 0))))


def test_overridden_lights_are_static_lights():
    state = world(LightOverride("Sun", 0.5)).state(3)
    assert not state.has_dynamic_lights
    assert state.lights[1].irradiance == (1.0, 2.0, 3.0)


def test_motion_of_a_light_multiplies_its_override():
    motion = ts.LightMotion("Sun", times=(0.0,), intensity=(3.0,))
    made = World(ts.Scenario("room", lights=[motion], overrides=[LightOverride("Sun", 0.5)]), STAGE, load, 25.0)
    assert made.state(0).lights[1].irradiance == (3.0, 6.0, 9.0)


def test_material_override_replaces_tints_and_copies():
    oak, cloth = overridden(STAGE, [MaterialOverride("Oak", tint=(2, 1, 2), roughness=0.1, metallic=1.0)]).materials
    assert (oak.diffuse_color, oak.roughness, oak.metallic) == ((0.4, 0.4, 1.0), 0.1, 1.0)
    assert cloth == STAGE.materials[1]
    _, cloth = overridden(STAGE, [MaterialOverride("/Looks/Cloth", tint=(2, 1, 0.5))]).materials
    assert cloth.diffuse_color.scale == (2.0, 1.0, 0.5, 1.0)
    oak, _ = overridden(STAGE, [MaterialOverride("Oak", like="Cloth")]).materials
    assert oak == replace(STAGE.materials[1], name="Oak", prim_path="/Looks/Oak")


def test_material_of_a_template_is_overridden():
    made = world(MaterialOverride("Paint", color=(1, 0, 0)), objects=[ts.Object("a", "Cube")])
    assert made.descriptions[1].materials[0].diffuse_color == (1.0, 0.0, 0.0)


def test_object_override_moves_meshes_lights_colliders_and_row():
    made = world(ObjectOverride("/Lamp", (1, 2, 3), (0, 90, 0)))
    state = made.state(0)
    assert state.objects[0].position == (1.0, 2.0, 3.0)
    np.testing.assert_allclose(state.lights[0].world_from_light[:3, 3], (1, 3, 3), atol=1e-12)
    np.testing.assert_allclose(made.stage.colliders[0].world_from_object[:3, 3], (1, 1, 3), atol=1e-12)
    places = state.placement.world_from_object[1, :, :, 3]
    np.testing.assert_allclose(places, [(1, 2, 3), (1, 4, 3), (0, 0, 0)], atol=1e-12)
    assert not state.movers.any()
    assert not state.changes


def test_invisible_object_keeps_the_ids_of_others():
    made = world(ObjectOverride("Lamp", visible=False))
    state = made.state(0)
    assert state.placement.instance_id.tolist() == [2]
    assert [light.name for light in state.lights] == ["Sun"]
    assert not made.stage.colliders


def test_camera_override_keeps_other_attributes():
    made = world(CameraOverride(position=(1, 1, 1), rotation=(0, 90, 0), vertical_fov=1.0))
    assert made.camera.name == "Door"
    assert (made.camera.position, made.camera.vertical_fov, made.camera.exposure) == ((1, 1, 1), 1.0, 3.0)
    np.testing.assert_allclose(made.camera.rotation, (0.5**0.5, 0, 0.5**0.5, 0))
    made = World(ts.Scenario("room", camera="Window", overrides=[CameraOverride("Window", lens_radius=0.1)]), STAGE,
                 load, 25.0)  # fmt: skip
    assert (made.camera.position, made.camera.lens_radius) == ((1, 2, 3), 0.1)


@pytest.mark.parametrize("override", [CameraOverride("Door", vertical_fov=1.0), CameraOverride(lens_radius=0.1)])
def test_override_of_a_camera_of_the_scenario_warns(override):
    own = ts.Camera(name="Door", dynamic=ts.Orbit())
    with pytest.warns(StageWarning, match="camera 'Door' is one of the scenario's own"):
        made = World(ts.Scenario("room", camera=own, overrides=[override]), STAGE, load, 25.0)
    assert made.camera == own
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        World(ts.Scenario("room", camera=("Door", replace(own, name="Own")), overrides=[override]), STAGE, load, 25.0)


@pytest.mark.parametrize(
    ("override", "error", "message"),
    [
        (LightOverride("Sum"), LightNotFound, "no light 'Sum' in scene 'room'. Did you mean"),
        (MaterialOverride("Oax"), MaterialNotFound, "no material 'Oax' on the stage or in a template"),
        (MaterialOverride("Oak", like="Walnut"), MaterialNotFound, "no material 'Walnut' in 'room'"),
        (ObjectOverride("/Lamb"), ObjectNotFound, "no object '/Lamb' in scene 'room'. Did you mean '/Lamp'"),
        (CameraOverride("Dor"), CameraNotFound, "no camera 'Dor'"),
    ],
)
def test_override_of_a_missing_prim_raises(override, error, message):
    with pytest.raises(error, match=message):
        world(override)


def test_animated_object_cannot_be_placed():
    track = InstanceTrack(np.array([1], np.int32), np.zeros(1), np.eye(4)[None, None, :3], np.ones((1, 1), bool))
    with pytest.raises(ScenarioError, match="'/Box' is animated by the stage"):
        overridden(replace(STAGE, tracks=(track,)), [ObjectOverride("Box", (0, 0, 0))])
