# SPDX-License-Identifier: Apache-2.0
"""Scenes that scenarios are drawn for are those of the files as they are."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import tiscene as ts
from tests.randomization.rooms import write_room
from tests.usd.helpers import write
from tiscene.export.generation.recipe import Recipe
from tiscene.randomization.scene_files import free_space_of, stage_of, variant_sets_of

VARIANTS = """
def Xform "Lamp" (prepend variantSets = "lighting") {
    variantSet "lighting" = {
        "day" {}
    }
}
"""
SETTINGS = '\ndef RenderSettings "Settings"\n{\n    uniform int2 resolution = (320, 160)\n}\n'


def test_scene_is_read_again_once_a_sublayer_has_changed(tmp_path):
    write_room(tmp_path, (0.0, 0.0, 3.0), {})
    file = write(tmp_path, "", name="scene.usda", more='subLayers = [@./room.usda@]\ndefaultPrim = "Room"')
    scenario, recipe = ts.Scenario(str(file)), Recipe.from_json({"scenes": [str(file)]})
    stage, space = stage_of(scenario), free_space_of(scenario)
    assert stage_of(scenario) is stage
    assert free_space_of(scenario) is space
    assert not stage.instances
    assert not variant_sets_of(scenario)
    assert recipe._aspect(str(file), {}) == 4 / 3
    room = Path(write_room(tmp_path, (0.0, 0.0, 3.0), {"Box": ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))}))
    room.write_text(room.read_text() + VARIANTS + SETTINGS)
    assert len(stage_of(scenario).instances) == 1
    assert free_space_of(scenario) is not space
    assert list(variant_sets_of(scenario)) == ["/Lamp{lighting}"]
    assert recipe._aspect(str(file), {}) == 2.0


def test_scenarios_are_drawn_again_after_a_restart_of_taichi(room_of_boxes):
    text = """
import sys
import taichi as ti
import tiscene as ts

def draw():
    ranges = {"objects": 1, "templates": ("Cup 01",), "clutter": {"count": 1, "templates": ("Cup 01",)}}
    return ts.Scenario.sample(sys.argv[1], seed=1, furniture=0.2, **ranges)

first = draw()
ti.reset()
assert draw() == first
ti.init(arch=ti.cpu, fast_math=False, advanced_optimization=False, log_level=ti.ERROR)
assert draw() == first
"""
    done = subprocess.run([sys.executable, "-c", text, room_of_boxes], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
