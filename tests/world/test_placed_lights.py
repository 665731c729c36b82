# SPDX-License-Identifier: Apache-2.0
"""Frames before an edit of a lamp do not depend on whether later ones were rendered before."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import tiscene as ts
from tests.usd.helpers import write

LAMP = """
    def Xform "Lamp" (kind = "component") {
        def Cube "Foot" {
            double size = 0.2
        }
        def SphereLight "Bulb" {
            float inputs:intensity = 30
            float inputs:radius = 0.1
            double3 xformOp:translate = (0, 2, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
"""
STAGE = """
def Xform "Room" {{
    {floor} "Floor" {{
        double size = 2
        double3 xformOp:translate = (0, -1, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
    {lamp}
    def DomeLight "Sky" {{
        {texture}
    }}
    def Camera "Camera" {{
        double3 xformOp:translate = (0, 1.5, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}
}}
"""


def stage(path, lamp="", texture="", floor="def Cube"):
    return str(write(path.parent, STAGE.format(lamp=lamp, texture=texture, floor=floor), name=path.name))


@pytest.mark.parametrize("batch", [1, 4])
def test_a_frame_before_a_lamp_is_moved_is_the_same_after_later_frames(tmp_path, batch):
    scene = stage(tmp_path / "room.usda", LAMP)
    with ts.Stream(scene, width=16, height=12, spp=2, buffers=("hdr",), denoise=False, batch=batch) as stream:
        before = stream[2].hdr.tobytes()
        stream.seek(5)
        stream.world.move("/Room/Lamp", (3.0, 3.0, 0.0))
        assert stream[6].hdr.tobytes() != before
        stream.seek(2)
        assert next(stream).hdr.tobytes() == before


def test_a_frame_before_a_lamp_is_spawned_is_the_same_in_a_replay(tmp_path):
    scene = stage(tmp_path / "room.usda")
    lamp = write(tmp_path, LAMP, name="lamp.usda", more='defaultPrim = "Lamp"')
    settings = {"width": 16, "height": 12, "spp": 2, "buffers": ("hdr",), "denoise": False}
    with ts.Stream(scene, **settings) as stream:
        before = stream[2].hdr.tobytes()
        stream.seek(5)
        stream.world.spawn(str(lamp), (1.0, 0.2, 0.0))
        lit = stream[6].hdr.tobytes()
        assert lit != before
        for frames in ((2, 6), (6, 2)):
            with ts.Stream(stream.scenario, **settings) as replay:
                assert {frame: replay[frame].hdr.tobytes() for frame in frames} == {2: before, 6: lit}


def test_exposure_is_metered_without_replaced_lights_whether_a_frame_was_rendered_or_not(tmp_path):
    def metered(rendered_before):
        with ts.Stream(stage(tmp_path / "room.usda", LAMP), width=16, height=12, spp=2, buffers=("hdr",)) as stream:
            bulb = stream.world.stage.lights[0]
            stream.set_light(0, replace(bulb, radiance=tuple(1000.0 * each for each in bulb.radiance)))
            if rendered_before:
                stream[0]
            return stream.exposure

    assert metered(True) == metered(False)


def test_base_images_under_skies_of_other_pictures_are_not_shared(tmp_path):
    """The only light is a dome's picture, and the only object moves: nothing else tells the stages apart."""
    path = [ts.Waypoint((-1.0, 0.0, 0.0)), ts.Waypoint((0.0, 0.0, 1.0)), ts.Waypoint((1.0, 0.0, 0.0))]
    ball = ts.Object("Ball", "Ball 01", dynamic=ts.CatmullWaypoints(path, total_time=3.0))
    means = []
    for name, level in (("dark", 40), ("bright", 220)):
        Image.fromarray(np.full((8, 16, 3), level, np.uint8)).save(tmp_path / f"{name}.png")
        picture = f"asset inputs:texture:file = @{name}.png@"
        scene = stage(tmp_path / f"{name}.usda", texture=picture, floor="over")
        settings = {"width": 16, "height": 12, "quality": "fast", "buffers": ("hdr",), "incremental": True}
        with ts.Stream(ts.Scenario(scene, [ball]), **settings) as stream:
            means.append(stream[3].hdr.mean())
    assert means[1] > 2.0 * means[0]
