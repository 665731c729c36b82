# SPDX-License-Identifier: Apache-2.0
"""Objects, labels and parts."""

from __future__ import annotations

import numpy as np
import pytest

import tiscene
from tests.usd.helpers import QUAD, read, write
from tests.usd.read.test_instancers import INSTANCER
from tiscene.errors import StageError, UnknownName
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.template import read_template


def label(name: str, *taxonomies: tuple[str, str], kind: str = "", inside: str = "", type_: str = "Xform") -> str:
    """Return a prim with labels, by (taxonomy, label)."""
    schemas = ", ".join(f'"SemanticsLabelsAPI:{taxonomy}"' for taxonomy, _ in taxonomies)
    metadata = f"prepend apiSchemas = [{schemas}]\n" if taxonomies else ""
    metadata += f'kind = "{kind}"' if kind else ""
    lines = "\n".join(f'token[] semantics:labels:{taxonomy} = ["{text}"]' for taxonomy, text in taxonomies)
    return f'def {type_} "{name}" ({metadata})\n{{\n{lines}\n{inside}\n}}\n'


def test_labels_are_inherited_and_the_nearest_wins(tmp_path):
    inside = label("Plain", type_="Cube") + label("Own", ("class", "lamp"), type_="Cube")
    body = label("Room", ("class", "room"), inside=inside) + label("Outside", type_="Cube")
    categories = {each.name: each.category for each in read(tmp_path, body).objects}
    assert categories == {"Plain": "room", "Own": "lamp", "Outside": ""}


def test_taxonomies(tmp_path):
    body = (
        label("A", ("category", "two"), ("class", "one"), type_="Cube")
        + label("B", ("zebra", "z"), ("category", "two"), type_="Cube")
        + label("C", ("zebra", "z"), ("ant", "a"), type_="Cube")
    )
    assert [each.category for each in read(tmp_path, body).objects] == ["one", "two", "a"]


def blender(name: str, object_name: str, data: str, instanceable: bool = False) -> str:
    """Return an object as Blender 5.0 exports it: a transform, and the mesh that is its data."""
    return f"""
def Xform "{name}" (instanceable = {str(instanceable).lower()}) {{
    custom string userProperties:blender:object_name = "{object_name}"
    def Cube "{data}" {{}}
}}"""


def test_categories_of_a_blender_stage_without_labels_are_the_names_of_its_objects(tmp_path):
    merged = """
def Cube "Merged" {
    custom string userProperties:blender:object_name = "Shelf 2"
}
def Xform "Parent" {
    custom string userProperties:blender:object_name = "Group"
    def Xform "Child" {
        def Cube "Plain_2" {}
    }
}"""
    body = (
        blender("Chair_001", "Chair.001", "Cube")
        + blender("Table", "Table", "Cube_001")
        + blender("Cone_13_0", "Cone.002", "Mesh", instanceable=True)
        + merged
    )
    assert [each.category for each in read(tmp_path, body).objects] == ["Chair", "Table", "Cone", "Shelf", "Plain"]


def test_objects_have_the_names_that_they_have_in_blender_unless_they_are_copies(tmp_path):
    copies = "".join(
        f"""
def Xform "Cone_{row}_0" (instanceable = true
    references = </M_0>) {{
    custom string userProperties:blender:object_name = "Cone"
}}"""
        for row in range(2)
    )
    body = blender("M_0", "M.0", "Suzanne") + blender("M_1", "M.1", "Suzanne") + copies
    assert [each.name for each in read(tmp_path, body).objects] == ["M.0", "M.1", "Cone_0_0", "Cone_1_0"]


def omniverse(name: str, *labels: tuple[str, str], inside: str = "", schemas: str = "") -> str:
    """Return a cube with labels of Omniverse's SemanticsAPI, by (semanticType, semanticData)."""
    applied = ", ".join(
        [f'"SemanticsAPI:Semantics_{number}"' for number in range(len(labels))] + [schemas] * bool(schemas)
    )
    lines = "".join(
        f'string semantic:Semantics_{number}:params:semanticType = "{kind}"\n'
        f'string semantic:Semantics_{number}:params:semanticData = "{text}"\n'
        for number, (kind, text) in enumerate(labels)
    )
    return f'def Cube "{name}" (prepend apiSchemas = [{applied}])\n{{\n{lines}{inside}\n}}\n'


def test_labels_of_omniverse_are_read_where_there_are_no_others(tmp_path):
    body = (
        omniverse("A", ("color", "red"), ("class", "crate"))
        + omniverse("B", ("color", "red"))
        + omniverse("C", ("class", "crate"), inside='token[] semantics:labels:class = ["box"]',
                    schemas='"SemanticsLabelsAPI:class"')
        + label("D", type_="Cube")
    )  # fmt: skip
    path = write(tmp_path, body)
    assert [each.category for each in read_stage(path).objects] == ["crate", "red", "box", ""]
    assert [each.category for each in read_stage(path, taxonomy="color").objects] == ["red", "red", "", ""]
    with pytest.raises(UnknownName, match="There are: class, color"):
        read_stage(path, taxonomy="wikidata")


def test_component_is_one_object(tmp_path):
    parts = label("Seat", ("class", "cushion"), type_="Cube") + label("Leg", type_="Cube")
    body = (
        label("Named", ("class", "chair"), kind="component", inside=parts)
        + label("Unnamed", kind="component", inside=parts)
        + label("Room", ("class", "room"), kind="group", inside=label("Stool", kind="component", inside=parts))
        + label("Sub", kind="subcomponent", inside=parts)
    )
    description = read(tmp_path, body)
    assert [(each.name, each.category) for each in description.objects] == [
        ("Named", "chair"),
        ("Unnamed", "cushion"),
        ("Stool", "cushion"),  # the label of its part is nearer than that of the room
        ("Seat", "cushion"),
        ("Leg", ""),
    ]
    assert [i.object for i in description.instances] == [0, 0, 1, 1, 2, 2, 3, 4]


def test_the_nearest_component_wins(tmp_path):
    inner = label("Inner", kind="component", inside=label("A", type_="Cube"))
    body = label("Outer", kind="component", inside=inner + label("B", type_="Cube"))
    description = read(tmp_path, body)
    assert [each.prim_path for each in description.objects] == ["/Outer/Inner", "/Outer"]


def test_instance_is_one_object_whatever_its_prototype(tmp_path):
    quad = f'def Mesh "Quad"\n{{\n{QUAD}\n}}'
    body = f"""
    class "Thing" {{
        {quad}
    }}
    def "A" (inherits = </Thing>
        instanceable = true) {{}}
    def "B" (inherits = </Thing>
        instanceable = true) {{}}
    """
    description = read(tmp_path, body)
    assert [each.prim_path for each in description.objects] == ["/A", "/B"]
    assert len(description.meshes) == 1


def test_instance_of_an_assembly_has_several_objects(tmp_path):
    body = """
    class "Corner" (kind = "assembly") {
        def Cube "Sofa" {}
        def Sphere "Lamp" {}
    }
    def "A" (inherits = </Corner>
        instanceable = true) {}
    """
    description = read(tmp_path, body)
    assert [each.prim_path for each in description.objects] == ["/A/Sofa", "/A/Lamp"]


TWO_TAXONOMIES = """
def Xform "A" (prepend apiSchemas = ["SemanticsLabelsAPI:wikidata", "SemanticsLabelsAPI:category"]) {
    token[] semantics:labels:wikidata = ["Q42177"]
    token[] semantics:labels:category = ["furniture"]
    def Cube "Bed" (prepend apiSchemas = ["SemanticsLabelsAPI:class"]) {
        token[] semantics:labels:class = ["bed", "sleep"]
    }
    def Cube "Shelf" {}
}
"""


@pytest.mark.parametrize(
    ("taxonomy", "expected"),
    [(None, ["bed", "furniture"]), ("class", ["bed", ""]), ("wikidata", ["Q42177", "Q42177"])],
)
def test_requested_taxonomy_gives_the_labels(tmp_path, taxonomy, expected):
    path = write(tmp_path, TWO_TAXONOMIES)
    assert [each.category for each in read_stage(path, taxonomy=taxonomy).objects] == expected


def test_unknown_taxonomy_raises_unknown_name(tmp_path):
    path = write(tmp_path, TWO_TAXONOMIES)
    with pytest.raises(UnknownName, match=r"no taxonomy 'klass' in stage.usda\. Did you mean 'class'\?"):
        read_stage(path, taxonomy="klass")
    with pytest.raises(UnknownName, match="Nothing on the stage has a semantic label"):
        read_stage(write(tmp_path, 'def Cube "A" {}'), taxonomy="class")


def test_names_give_categories_on_stages_without_labels(tmp_path):
    body = """
def Xform "Chair_01" (kind = "component") {
    def Cube "Seat" {}
}
def Xform "C2" (
    kind = "component"
    assetInfo = { string name = "Table-12" }
) {
    def Cube "Top" {}
}
def Cube "Floor" {}
def Cube "_12" {}
"""
    assert [each.category for each in read(tmp_path, body).objects] == ["Chair", "Table", "Floor", "_12"]
    some = body.replace('def Cube "Floor"', 'def Cube "Floor" (prepend apiSchemas = ["SemanticsLabelsAPI:class"])')
    some = some.replace('API:class"]) {', 'API:class"]) {\n    token[] semantics:labels:class = ["floor"]\n')
    assert [each.category for each in read(tmp_path, some).objects] == ["", "", "floor", ""]
    scattered = INSTANCER.replace('"Ball"', '"Ball_7"').replace("</P/Ball>", "</P/Ball_7>") % ""
    assert [each.category for each in read(tmp_path, scattered).objects] == ["Ball", "Ball"]


def test_asset_name_comes_from_asset_info_or_referenced_file(tmp_path):
    xform = 'def Xform "{}"\n{{\n    def Cube "C" {{}}\n}}\n'
    write(tmp_path, xform.format("Seat"), name="oak_chair.usda", more='defaultPrim = "Seat"')
    cups = xform.format("Cup") + xform.format("Dish")
    write(tmp_path, cups, name="crockery.usda", more='defaultPrim = "Cup"')
    body = """
def Xform "Set" (assetInfo = { string name = "Dining set" }) {
    def Xform "Left" (
        kind = "component"
        references = @./oak_chair.usda@) {}
    def Xform "Right" (
        kind = "component"
        instanceable = true
        payload = @./oak_chair.usda@) {}
    def Xform "Dish" (
        kind = "component"
        references = @./crockery.usda@</Dish>) {}
    def Xform "Cup" (
        kind = "component"
        references = @./crockery.usda@</Cup>) {}
    def Xform "Jug" (
        kind = "component"
        assetInfo = { string name = "Jug" }
        references = @./crockery.usda@) {}
}
def Xform "Alone" (kind = "component") {
    def Xform "Box" (references = @./crockery.usda@) {}
}
"""
    assets = {each.prim_path: each.asset for each in read(tmp_path, body).objects}
    assert assets == {
        "/Set/Left": "Oak Chair",
        "/Set/Right": "Oak Chair",
        "/Set/Cup": "Crockery",  # the default prim, by its path
        "/Set/Dish": "Dining set",  # a part of a file is no asset
        "/Set/Jug": "Jug",
        "/Alone": "",  # assets of its parts do not count
    }
    assert read_template(tmp_path / "oak_chair.usda").description.objects[0].asset == "Oak Chair"


PARTS = """
def Xform "Chair" (kind = "component") {
    def Cube "Seat" {}
    def Xform "Frame" {
        def Mesh "Legs" {
            uniform token subdivisionScheme = "none"
            int[] faceVertexCounts = [3, 3, 3]
            int[] faceVertexIndices = [0, 1, 2, 0, 2, 3, 0, 3, 1]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1)]
            def GeomSubset "Left" {
                int[] indices = [2]
            }
            def GeomSubset "Right" {
                int[] indices = [0]
            }
        }
    }
}
def Sphere "Ball" {}
"""


def test_parts_are_meshes_and_their_subsets(tmp_path):
    """A part for each mesh, each subset of one, and its faces in no subset."""
    description = read(tmp_path, PARTS)
    chair, ball = description.objects
    assert chair.parts == ("Seat", "Frame/Legs/Left", "Frame/Legs/Right", "Frame/Legs")
    assert ball.parts == ()
    assert [each.part for each in description.instances] == [0, 1, 0]
    seat, legs, _ = (description.meshes[each.mesh] for each in description.instances)
    assert seat.parts is None
    np.testing.assert_array_equal(legs.parts, [1, 2, 0])


def test_part_subsets_take_precedence_over_material_subsets(tmp_path):
    right = 'def GeomSubset "Right" {'
    body = PARTS.replace(right, f'{right}\n uniform token familyName = "materialBind"')
    assert read(tmp_path, body).objects[0].parts == ("Seat", "Frame/Legs/Left", "Frame/Legs")


def test_template_is_one_object_with_all_parts(tmp_path):
    body = 'def Xform "Set"\n{\n' + PARTS.replace('kind = "component"', 'kind = "subcomponent"') + "}\n"
    template = read_template(write(tmp_path, body, more='defaultPrim = "Set"'))
    (each,) = template.description.objects
    assert each.parts == ("Seat", "Legs/Left", "Legs/Right", "Legs", "Ball")
    assert [(each.object, each.part) for each in template.description.instances] == [(0, 0), (0, 1), (0, 4)]


def labeled(path, **options):
    return tiscene.Stream(path, buffers=("semantic",), **options)


def test_stream_reads_the_requested_taxonomy(tmp_path):
    path = write(tmp_path, TWO_TAXONOMIES)
    default, chosen = (labeled(path, taxonomy=taxonomy) for taxonomy in (None, "wikidata"))
    assert set(default.categories.values()) == {"", "bed", "furniture"}
    assert set(chosen.categories.values()) == {"", "Q42177"}
    assert chosen.settings()["taxonomy"] == "wikidata"
    assert chosen.state_dict() != default.state_dict()
    with pytest.raises(UnknownName, match="no taxonomy 'x'"):
        labeled(path, taxonomy="x")


def test_stream_of_an_untrusted_stage(tmp_path):
    path = write(tmp_path, TWO_TAXONOMIES)
    assert labeled(path, untrusted=True).categories == labeled(path).categories
    (tmp_path / "empty").mkdir()
    with pytest.raises(StageError, match="is outside"):
        labeled(path, root=tmp_path / "empty")
    with pytest.raises(StageError, match="is outside"):
        labeled(path, root=tmp_path / "empty", untrusted=True)
