# SPDX-License-Identifier: Apache-2.0
"""Models drawn as cards (model:drawMode), with texture coordinates as OpenUSD's imaging has them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from PIL import Image

import tiscene as ts
from tests.usd.helpers import read, read_with_warning, write
from tiscene.errors import StageWarning

MODEL = """def Xform "Tree" (
    kind = "%s"
    prepend apiSchemas = ["GeomModelAPI"]
)
{
    uniform token model:drawMode = "cards"
    %s
    def Cube "Trunk"
    {
        double size = 2
        double3 xformOp:translate = (0, 0, 1)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""
RED, GREEN, BLUE, GRAY = (255, 0, 0), (0, 255, 0), (0, 0, 255), (128, 128, 128)


def model(lines: str = "", kind: str = "component") -> str:
    return MODEL % (kind, lines)


@pytest.fixture
def textures(tmp_path):
    """Write front.png: red, green above blue, transparent; and back.png: gray."""
    front = np.zeros((4, 4, 4), np.uint8)
    front[..., 3] = 255
    front[:2, :2, :3], front[:2, 2:, :3], front[2:, :2, :3] = RED, GREEN, BLUE
    front[2:, 2:] = 0
    Image.fromarray(front).save(tmp_path / "front.png")
    Image.new("RGB", (2, 2), GRAY).save(tmp_path / "back.png")
    return tmp_path


def meshes(description):
    """Return by the card's name its mesh."""
    return {description.meshes[each.mesh].name: description.meshes[each.mesh] for each in description.instances}


def place_of(mesh, u, v):
    """Return where on a card the texture coordinates (u, v) are."""
    (row,) = np.flatnonzero((mesh.uv == (u, v)).all(axis=1))
    return mesh.positions[row].tolist()


# Places of the texture's lower left, lower right and upper left corner; the extent is -1..1, -1..1, 0..2.
SIDES = {
    "XPos": ((-1, 0), (1, 0), (-1, 2)),  # seen from +x with z up, y runs to the right
    "XNeg": ((1, 0), (-1, 0), (1, 2)),
    "YPos": ((1, 0), (-1, 0), (1, 2)),
    "YNeg": ((-1, 0), (1, 0), (-1, 2)),
    "ZPos": ((-1, -1), (1, -1), (-1, 1)),
    "ZNeg": ((-1, 1), (1, 1), (-1, -1)),
}


@pytest.mark.parametrize("side", SIDES)
def test_box_shows_one_texture_on_both_sides_of_an_axis(textures, side):
    lines = f'uniform token model:cardGeometry = "box"\nasset model:cardTexture{side} = @./front.png@'
    found = meshes(read(textures, model(lines)))
    axis = "XYZ".index(side[0])
    assert set(found) == {f"Card{side[0]}Pos", f"Card{side[0]}Neg"}
    for name, mesh in found.items():
        at = [(-1, -1, 0), (1, 1, 2)][name.endswith("Pos")][axis]
        corners = [place_of(mesh, *uv) for uv in ((0, 0), (1, 0), (0, 1))]
        assert {corner.pop(axis) for corner in corners} == {at}
        assert tuple(map(tuple, corners)) == SIDES[side]


def test_each_side_has_its_own_texture(textures):
    lines = "".join(f"asset model:cardTexture{side} = @./front.png@\n" for side in ("ZPos", "ZNeg"))
    found = meshes(read(textures, model(lines)))
    assert set(found) == {"CardZPos", "CardZNeg"}
    for side in ("ZPos", "ZNeg"):
        corners = [place_of(found[f"Card{side}"], *uv) for uv in ((0, 0), (1, 0), (0, 1))]
        assert tuple((x, y) for x, y, _ in corners) == SIDES[side]
        (height,) = {z for *_, z in corners}
        assert height == pytest.approx(1.0, abs=2e-4)
        assert (height > 1.0) is (side == "ZPos")


def test_cards_without_textures_have_the_color_of_the_model(tmp_path):
    description = read(tmp_path, model("float3 model:drawModeColor = (0.2, 0.4, 0.6)"))
    assert set(meshes(description)) == {"CardXPos", "CardYPos", "CardZPos"}
    for mesh in description.meshes:
        assert description.materials[mesh.materials[0]].diffuse_color == pytest.approx((0.2, 0.4, 0.6))
    assert [each.name for each in description.objects] == ["Tree"]


def test_cards_of_the_up_axis_are_hidden_where_cards_are_simple(tmp_path):
    assert set(meshes(read(tmp_path, model('uniform token model:cardVisibility = "simple"')))) == {
        "CardXPos",
        "CardZPos",
    }


def test_frame_shows_the_texture_upright_with_its_holes(textures):
    """Seen from +z: red and green above, blue below, and a hole below on the right, through which the wall is seen."""
    body = model("asset model:cardTextureZPos = @./front.png@")
    body += """def Plane "Wall"
{
    color3f[] primvars:displayColor = [(1, 1, 0)]
    double width = 20
    double length = 20
    double3 xformOp:translate = (0, 0, -5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Camera "C"
{
    token projection = "orthographic"
    float horizontalAperture = 20
    float verticalAperture = 20
    double3 xformOp:translate = (0, 0, 9)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
    path = write(textures, body)
    with ts.Stream(path, width=8, height=8, buffers=("albedo", "instance"), camera="C") as stream:
        frame = stream[0]
        names = {row.id: row.name for row in frame.objects}
    seen = frame.albedo[[1, 1, 6, 6], [1, 6, 1, 6]]
    np.testing.assert_allclose(seen, [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)], atol=1e-3)
    assert [names[each] for each in frame.instance[[1, 1, 6, 6], [1, 6, 1, 6]].tolist()] == ["Tree"] * 3 + ["Wall"]


@pytest.mark.parametrize(
    ("body", "cards"),
    [
        (model(), True),
        (model(kind="group"), False),
        (model("uniform bool model:applyDrawMode = 1", kind="group"), True),
        (model("uniform bool model:applyDrawMode = 0"), False),
        (model().replace('"cards"', '"default"'), False),
        (model().replace('"cards"', '"inherited"'), False),
        (f'def Xform "Set" (kind = "group")\n{{\nuniform token model:drawMode = "cards"\n'
         f'{model().replace(chr(34) + "cards" + chr(34), chr(34) + "inherited" + chr(34))}}}\n', True),
    ],
)  # fmt: skip
def test_modes_apply_to_components_and_where_they_are_asked_for(tmp_path, body, cards):
    with warnings.catch_warnings():
        warnings.simplefilter("error", StageWarning)
        names = set(meshes(read(tmp_path, body)))
    assert names == ({"CardXPos", "CardYPos", "CardZPos"} if cards else {"Trunk"})


def test_instances_are_drawn_as_cards_each(tmp_path):
    body = model(kind="component").replace('def Xform "Tree"', 'class Xform "Tree"')
    for number in range(2):
        body += f'def "I{number}" (\ninstanceable = true\nreferences = </Tree>\n)\n{{\n}}\n'
    description = read(tmp_path, body)
    assert [each.name for each in description.objects] == ["I0", "I1"]
    assert {mesh.name for mesh in description.meshes} == {"CardXPos", "CardYPos", "CardZPos"}


def test_instance_that_holds_models_drawn_as_cards_stays_one_object(tmp_path):
    lines = "uniform bool model:applyDrawMode = 1"
    trees = "".join(model(lines, "").replace('"Tree"', f'"Tree{number}"') for number in range(2))
    body = f'class "Wood"\n{{\n{trees}}}\n' + 'def "Copy" (\ninstanceable = true\nreferences = </Wood>\n)\n{\n}\n'
    assert [each.name for each in read(tmp_path, body).objects] == ["Copy"]


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (model().replace('"cards"', '"bounds"'), "model:drawMode 'bounds' is lines without width: the model itself"),
        (model().replace('"cards"', '"origin"'), "model:drawMode 'origin' is lines without width"),
        (model('uniform token model:cardGeometry = "fromTexture"'), "cards of the geometry 'fromTexture' are not"),
        (
            'def Cube "Box" (kind = "component")\n{\nuniform token model:drawMode = "cards"\n}\n',
            "the cards of a model that is a gprim are not drawn: the model itself is drawn",
        ),
    ],
)
def test_modes_that_are_not_applied_are_named(tmp_path, body, text):
    assert len(read_with_warning(tmp_path, body, text).instances) == 1


def test_missing_texture_is_named_and_the_color_drawn(tmp_path):
    description = read_with_warning(
        tmp_path, model("asset model:cardTextureXPos = @./gone.png@"), r"no texture @/.*/gone.png@ \(of its cards\)"
    )
    assert set(meshes(description)) == {"CardXPos"}
