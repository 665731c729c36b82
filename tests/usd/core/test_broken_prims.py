# SPDX-License-Identifier: Apache-2.0
"""Endless point instancers, which crash USD where their bounds are computed, and transforms that USD cannot read."""

from __future__ import annotations

import pytest
from pxr import Usd, UsdGeom

from tests.usd.helpers import read_with_warning, write
from tiscene.usd.core.broken_prims import deactivate_broken, has_bounds
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.stage import open_stage
from tiscene.usd.joining.room_join import join
from tiscene.usd.read.room_volumes import interior

ROOM = 'prepend apiSchemas = ["SemanticsLabelsAPI:room"]'
CARDS = 'kind = "component"\nprepend apiSchemas = ["GeomModelAPI"]'
BAD_TRANSFORM = """def Cube "Bad" {
    double3 xformOp:foo = (1, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:foo"]
}
"""


def instancer(name: str, prototype: str, metadata: str = "", lines: str = "") -> str:
    return f"""def PointInstancer "{name}" ({metadata}) {{
    int[] protoIndices = [0]
    point3f[] positions = [(9, 0, 0)]
    rel prototypes = [<{prototype}>]
    {lines}
}}
"""


def root(inside: str, metadata: str = "", name: str = "Root") -> str:
    return f'def Xform "{name}" ({metadata})\n{{\n{inside}\n}}\n'


CUBE = 'def Cube "Good" {}\n'
ENDLESS = {
    "itself": instancer("A", "/Root/A"),
    "each other": instancer("A", "/Root/B") + instancer("B", "/Root/A"),
    "prim above": instancer("A", "/Root"),
}


def problems(path, prim="/Root") -> tuple[Usd.Stage, str]:
    """Return a stage without its broken prims, and what is reported of them."""
    stage, report = open_stage(path), StageReport("stage", strict=True)
    deactivate_broken(stage.GetPrimAtPath(prim), report)
    with pytest.raises(Exception, match="problem") as caught:
        report.raise_problems()
    return stage, str(caught.value)


@pytest.mark.parametrize("body", ENDLESS.values(), ids=ENDLESS)
def test_endless_instancers_are_deactivated_before_bounds_are_computed(tmp_path, body):
    path = write(tmp_path, root(CUBE + body))
    assert not has_bounds(open_stage(path).GetPrimAtPath("/Root"))
    stage, text = problems(path)
    assert "</Root/A> instancer: one of its prototypes contains the instancer itself" in text
    assert interior(stage.GetPrimAtPath("/Root"))[1].tolist() == [1.0, 1.0, 1.0]
    assert not stage.GetRootLayer().dirty


def test_instancer_of_another_one_keeps_its_bounds(tmp_path):
    ball = 'def Sphere "Ball" {}\n'
    nested = root(ball + instancer("A", "/Root/B") + instancer("B", "/Root/Ball"))
    stage = open_stage(write(tmp_path, nested))
    deactivate_broken(stage.GetPrimAtPath("/Root"), StageReport("stage"))
    assert has_bounds(stage.GetPrimAtPath("/Root"))
    assert interior(stage.GetPrimAtPath("/Root"))[1].tolist() == [19.0, 1.0, 1.0]


def test_broken_prims_of_instances_are_deactivated_in_each(tmp_path):
    source = root(CUBE + instancer("A", "/Source/A") + BAD_TRANSFORM, name="Source").replace("def Xform", "class Xform")
    uses = "".join(root("", "instanceable = true\nreferences = </Source>", name) for name in ("First", "Second"))
    stage, text = problems(write(tmp_path, source + root(uses)))
    for name in ("First", "Second"):
        assert f"</Root/{name}/A>" in text
        assert f"</Root/{name}/Bad>" in text
    assert interior(stage.GetPrimAtPath("/Root"))[1].tolist() == [1.0, 1.0, 1.0]


def test_endless_instancer_as_room_volume_or_among_cards_is_left_out(tmp_path):
    volume = instancer("A", "/A", ROOM, 'token[] semantics:labels:room = ["kitchen"]')
    expected = "</A> room volume: a point instancer in it contains itself; left out"
    assert not read_with_warning(tmp_path, CUBE + volume, expected).rooms
    model = 'uniform token model:drawMode = "cards"\n' + CUBE + instancer("A", "/Root/A")
    expected = "cards of a model with a point instancer that contains itself are not drawn"
    assert len(read_with_warning(tmp_path, root(model, CARDS), expected).instances) == 1


def test_room_volume_without_a_readable_transform_is_left_out(tmp_path):
    volume = BAD_TRANSFORM.replace('"Bad"', f'"Bad" ({ROOM})').replace("{", '{\ntoken[] semantics:labels:room = ["a"]')
    description = read_with_warning(tmp_path, CUBE + volume, "</Bad> cannot be read: .*'foo'.*; left out")
    assert (len(description.instances), description.rooms) == (1, ())


def test_join_leaves_broken_prims_out_of_what_it_measures(tmp_path):
    body = CUBE + ENDLESS["itself"] + BAD_TRANSFORM
    file = write(tmp_path, root(body), name="den.usda", more='defaultPrim = "Root"')
    with pytest.warns(match=r"den\.usda is not drawn .*\n.*</Flat/den/A> instancer(.*\n)+.*</Flat/den/Bad> cannot"):
        flat = join([(file, (5.0, 0.0, 0.0))], tmp_path / "flat.usda")
    stage = Usd.Stage.Open(str(flat))
    assert stage.GetPrimAtPath("/Flat/den/A").IsActive()
    box = UsdGeom.Xformable(stage.GetPrimAtPath("/Flat/den/RoomVolume")).GetLocalTransformation()
    assert [box[axis][axis] for axis in range(3)] == [2.0, 2.0, 2.0]


def test_join_refuses_a_room_that_it_cannot_place(tmp_path):
    file = write(tmp_path, BAD_TRANSFORM, name="den.usda", more='defaultPrim = "Bad"')
    with pytest.raises(Exception, match=r"den\.usda has 2 problems:\n  </Flat/den> cannot be read: .*'foo'"):
        join([(file, (5.0, 0.0, 0.0))], tmp_path / "flat.usda")
