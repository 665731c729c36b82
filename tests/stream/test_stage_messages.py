# SPDX-License-Identifier: Apache-2.0
"""What a stream says of its stage: light that is missing, what is not drawn, templates that are not there."""

from __future__ import annotations

import pytest

import tiscene as ts
from tiscene.cli.main import main
from tiscene.errors import StageWarning, TemplateNotFound


def test_a_stage_without_light_is_lit_and_told_where_color_is_wanted(tmp_path):
    path = tmp_path / "dark.usda"
    path.write_text('#usda 1.0\n(\n    metersPerUnit = 1\n)\ndef Cube "Box" {}\n')
    with pytest.warns(StageWarning, match=r"dark\.usda: there is no light.*For another light") as told:
        stream = ts.Stream(path, width=16, height=12, spp=1)
    assert stream[0].rgb.any(axis=2).all()
    assert [each.name for each in stream.world.state(0).lights] == ["Sky", "Sun"]
    assert [each.filename for each in told] == [__file__]
    ts.Stream(path, buffers=("depth", "albedo"))
    lamp = ts.Scenario(str(path), [ts.Object("lamp", "Lamp Floor 01")])
    assert len(ts.Stream(lamp).world.stage.lights) == 0
    path.write_text(path.read_text() + 'def DomeLight "Sky" {}\n')
    ts.Stream(path)  # warnings are errors here


OFF = {
    "intensity": 'def SphereLight "Lamp"\n{\n    float inputs:intensity = 0\n}',
    "visibility": 'def Xform "G"\n{\n    token visibility = "invisible"\n    def DomeLight "Sky" {}\n}',
    "never visible": 'def DomeLight "L"\n{\n    token visibility.timeSamples = { 0: "invisible", 9: "invisible" }\n}',
    "mesh": 'def Sphere "L" (\n    prepend apiSchemas = ["MeshLightAPI"]\n)\n{\n    float inputs:intensity = 0\n}',
}


@pytest.mark.parametrize("lights", OFF.values(), ids=OFF)
def test_a_stage_whose_lights_are_all_off_is_dark_and_told(tmp_path, lights, capsys):
    path = tmp_path / "night.usda"
    path.write_text(f'#usda 1.0\n(\n    metersPerUnit = 1\n)\ndef Cube "Box" {{}}\n{lights}\n')
    text = r"night\.usda: all of its lights are off or invisible, so it is dark\. Turn one on, or remove them all\."
    with pytest.warns(StageWarning, match=text) as told:
        stream = ts.Stream(path, width=16, height=12, spp=1)
    assert [each.filename for each in told] == [__file__]
    assert not stream[0].rgb.any()
    lamp = ts.Stream(ts.Scenario(str(path), [ts.Object("lamp", "Lamp Floor 01")]), width=16, height=12)  # no warning
    assert "Sun" not in [each.name for each in lamp.world.state(0).lights]
    main(["inspect", str(path)])
    assert "all lights are off or invisible, so it is dark" in capsys.readouterr().out


BROKEN = {
    "of guides": 'def DomeLight "L"\n{\n    uniform token purpose = "guide"\n}',
    "inactive": 'def DomeLight "L" (\n    active = false\n) {}',
}


@pytest.mark.parametrize("lights", BROKEN.values(), ids=BROKEN)
def test_lights_that_are_not_part_of_the_picture_do_not_make_it_dark(tmp_path, lights):
    path = tmp_path / "dark.usda"
    path.write_text(f'#usda 1.0\n(\n    metersPerUnit = 1\n)\ndef Cube "Box" {{}}\n{lights}\n')
    with pytest.warns(StageWarning, match="there is no light"):
        stream = ts.Stream(path, width=16, height=12, spp=1)
    assert [each.name for each in stream.world.state(0).lights] == ["Sky", "Sun"]


@pytest.mark.parametrize("limits", [None, ts.Limits()], ids=["in this process", "in another process"])
def test_warnings_of_a_stage_name_the_line_that_makes_the_stream(tmp_path, limits):
    path = tmp_path / "fog.usda"
    path.write_text('#usda 1.0\ndef Cube "Box" {}\ndef Volume "Fog" {}\n')
    with pytest.warns(StageWarning, match="Volume are not drawn") as told:
        ts.Stream(path, buffers=("depth",), limits=limits)
    assert [each.filename for each in told] == [__file__]


def test_the_name_of_an_object_of_the_stage_in_place_of_a_template_is_refused_with_its_path(tmp_path):
    path = tmp_path / "desk.usda"
    path.write_text('#usda 1.0\ndef Xform "Desk"\n{\n    def Cube "Blotter" {}\n}\n')
    scenario = ts.Scenario(str(path), [ts.Object("x", "Blotter")])
    expected = r"no template 'Blotter' in scene .*The object 'Blotter' of the stage is the template '/Desk/Blotter'\."
    with pytest.raises(TemplateNotFound, match=expected):
        ts.Stream(scenario, buffers=("depth",))
