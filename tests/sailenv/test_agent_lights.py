# SPDX-License-Identifier: Apache-2.0
"""Lights and backgrounds of an Agent's views."""

import numpy as np
import pytest

from tests.sailenv.conftest import SCENE
from tiscene.sailenv.light_controls import LightControls
from tiscene.scene.description import SphereLight


def test_clear_flags_change_only_the_background(make_agent):
    agent = make_agent(spp=4)
    agent.spawn_object("Cube", (0, 1, 2), (20, 30, 0))
    before = agent.get_frame()
    agent.change_main_camera_clear_flags(0, 0, 0)
    after = agent.get_frame()["main"]
    there = before["object"].any(axis=-1)
    near, inner = there.copy(), there.copy()
    for shift, axis in ((1, 0), (-1, 0), (1, 1), (-1, 1)):
        near |= np.roll(there, shift, axis)
        inner &= np.roll(there, shift, axis)
    assert not after[~near].any()
    assert inner.sum() > 50
    np.testing.assert_allclose(after[inner].mean(axis=0), before["main"][inner].mean(axis=0), atol=0.05)
    # Edge pixels mix black and the cube, without light of the sky.
    assert after[near & ~there].mean() < 0.6 * before["main"][near & ~there].mean()
    agent.change_main_camera_clear_flags(127, 0, 255)
    assert (np.rint(agent.get_frame()["main"][~near] * 255) == (127, 0, 255)).all()
    agent.change_main_camera_clear_flags(-1, 0, 0)
    np.testing.assert_allclose(agent.get_frame()["main"][0, 0], before["main"][0, 0], atol=3 / 255)


def test_light_setters_change_the_image(make_agent):
    agent = make_agent(width=48, height=36, spp=4)
    agent.change_scene(SCENE)
    agent.spawn_object("Sphere", (0, 1, 1.2))
    inside = agent.get_frame()["object"].any(axis=-1)

    def mean():
        return agent.get_frame()["main"][inside].mean(axis=0)

    name = "Directional Light"
    assert agent.get_light_type(name) == "Directional"
    plain, color = mean(), agent.get_light_color(name)
    agent.set_light_color(name, 255, 0, 0)
    assert agent.get_light_color(name) == (255, 0, 0)
    red = mean()
    assert red[2] < plain[2] - 0.03
    agent.set_light_color(name, *color)
    assert agent.get_light_intensity("Main Light") == 1.0
    agent.set_light_intensity(name, 0.0)
    assert (mean() < plain - 0.03).all()
    agent.set_light_intensity(name, 1.0)
    np.testing.assert_allclose(mean(), plain, atol=0.02)
    direction = agent.get_light_direction(name)
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    agent.set_light_direction(name, (0, 0, -1))  # towards the camera: the visible side of the sphere is in shadow
    np.testing.assert_allclose(agent.get_light_direction(name), (0, 0, -1), atol=1e-6)
    assert (mean() < plain - 0.03).all()
    agent.set_light_direction(name, (0, 0, 1))
    assert mean().mean() > plain.mean()
    agent.set_light_position(name, (1, 2, 3))
    assert agent.get_light_position(name) == (1, 2, 3)


@pytest.mark.slow
def test_indirect_multiplier_scales_indirect_light(make_agent):
    agent = make_agent(width=32, height=24, scene="solid_benchmark/scene")
    means = {}
    for multiplier in (0.0, 1.0, 5.0):
        agent.set_light_indirect_multiplier("Directional Light", multiplier)
        assert agent.get_light_indirect_multiplier("Directional Light") == multiplier
        means[multiplier] = agent.get_frame()["main"].mean()
    assert means[0.0] + 0.03 < means[1.0] < means[5.0] - 0.03


def test_ambient_light_brightens_surfaces_and_not_the_background(make_agent):
    agent = make_agent(width=48, height=36)
    agent.spawn_object("Sphere", (0, 1, 1.2))
    before = agent.get_frame()
    inside = before["object"].any(axis=-1)
    assert agent.get_ambient_light_color() == (0, 0, 0)
    agent.set_ambient_light_color(0, 0, 255)
    assert agent.get_ambient_light_color() == (0, 0, 255)
    after = agent.get_frame()["main"]
    more = after[inside] - before["main"][inside]
    assert more[:, 2].mean() > 0.05
    assert more[:, 2].mean() > 2 * more[:, 0].mean()
    np.testing.assert_allclose(after[0, 0], before["main"][0, 0], atol=2 / 255)


def test_object_view_shows_an_object_at_its_origin_with_labels(make_agent):
    agent = make_agent(at=None, main_frame_active=False)
    agent.get_categories()
    for name in ("Cube", "Cylinder", "Chair 01"):
        id = agent.spawn_object(name)
        frame = agent.get_frame()
        there = frame["object"].any(axis=-1)
        assert there.mean() > 0.01
        assert not there[:, [0, -1]].any()
        rows, columns = np.nonzero(there)
        assert 16 < columns.mean() < 48
        assert 12 < rows.mean() < 36
        found = {agent.categories[number] for number in np.unique(frame["category"][there])}
        assert found == {name.lower().split()[0]}
        agent.despawn_object(id)


def test_background_of_object_view_has_one_color_and_no_suns(make_agent):
    agent = make_agent(at=None, object_frame_active=False, flow_frame_active=False)
    for rotation in ((0, 0, 0), (-47, -28, 0), (-39, 134, 0), (-8, 123, 0), (90, 0, 0)):
        agent.set_rotation(rotation)
        assert (np.rint(agent.get_frame()["main"] * 255) == (173, 173, 173)).all(), rotation
    agent.change_main_camera_clear_flags(255, 0, 0)
    assert (agent.get_frame()["main"] == (1, 0, 0)).all()
    agent.change_main_camera_clear_flags(-1, 0, 0)
    assert (np.rint(agent.get_frame()["main"] * 255) == (173, 173, 173)).all()


def test_lights_with_the_same_name_have_different_names_and_edits():
    paths = ("/R/A/Sun", "/R/A/Lamp", "/R/B/lamp", "/R/C/Lamp", "/R/C/Rim_Light", "/R/C/Main Light")
    changed = []
    lights = [
        SphereLight(
            name=path.rpartition("/")[2].replace("_", " "),
            world_from_light=np.eye(4),
            radiance=(1.0, 1.0, 1.0),
            radius=0.1,
            prim_path=path,
        )
        for path in paths
    ]
    controls = LightControls(lights, ["Directional Light"], lambda row, light: changed.append(row))
    expected = ["Directional Light", "Lamp", "R/B/lamp", "R/C/Lamp", "R/C/Rim_Light", "R/C/Main Light"]
    assert controls.names == expected
    for name in expected:
        controls.set_intensity(name, 0.0)
    assert changed == list(range(6))
    assert controls.find("Rim Light").row == 1
    assert LightControls(lights[:1], [], print).find("Rim Light").row == 0
