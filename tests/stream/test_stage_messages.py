# SPDX-License-Identifier: Apache-2.0
"""What a stream says of its stage: light that is missing, what is not drawn, templates that are not there."""

from __future__ import annotations

import pytest

import tiscene as ts
from tiscene.errors import StageWarning, TemplateNotFound


def test_a_stage_without_light_is_lit_and_told_where_color_is_wanted(tmp_path):
    path = tmp_path / "dark.usda"
    path.write_text('#usda 1.0\n(\n    metersPerUnit = 1\n)\ndef Cube "Box"\n{\n}\n')
    with pytest.warns(StageWarning, match=r"dark\.usda: there is no light.*For another light") as told:
        stream = ts.Stream(path, width=16, height=12, spp=1)
    assert stream[0].rgb.any(axis=2).all()
    assert [each.name for each in stream.world.state(0).lights] == ["Sky", "Sun"]
    assert [each.filename for each in told] == [__file__]
    ts.Stream(path, buffers=("depth", "albedo"))
    lamp = ts.Scenario(str(path), [ts.Object("lamp", "Lamp Floor 01")])
    assert len(ts.Stream(lamp).world.stage.lights) == 0
    path.write_text(path.read_text() + 'def DomeLight "Sky"\n{\n}\n')
    ts.Stream(path)  # warnings are errors here


@pytest.mark.parametrize("limits", [None, ts.Limits()], ids=["in this process", "in another process"])
def test_warnings_of_a_stage_name_the_line_that_makes_the_stream(tmp_path, limits):
    path = tmp_path / "fog.usda"
    path.write_text('#usda 1.0\ndef Cube "Box"\n{\n}\ndef Volume "Fog"\n{\n}\n')
    with pytest.warns(StageWarning, match="Volume are not drawn") as told:
        ts.Stream(path, buffers=("depth",), limits=limits)
    assert [each.filename for each in told] == [__file__]


def test_the_name_of_an_object_of_the_stage_in_place_of_a_template_is_refused_with_its_path(tmp_path):
    path = tmp_path / "desk.usda"
    path.write_text('#usda 1.0\ndef Xform "Desk"\n{\n    def Cube "Blotter"\n    {\n    }\n}\n')
    scenario = ts.Scenario(str(path), [ts.Object("x", "Blotter")])
    expected = r"no template 'Blotter' in scene .*The object 'Blotter' of the stage is the template '/Desk/Blotter'\."
    with pytest.raises(TemplateNotFound, match=expected):
        ts.Stream(scenario, buffers=("depth",))
