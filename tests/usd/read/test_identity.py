# SPDX-License-Identifier: Apache-2.0
"""Objects, labels, parts and colliders; native instances and point instances."""

from __future__ import annotations

import numpy as np
import pytest

import tiscene
from tests.usd.helpers import QUAD, STAGES, problems_of, read, read_with_warning, write
from tiscene.errors import StageError, UnknownName
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.template import read_template


def test_native_instances():
    description = read_stage(STAGES / "instances.usda")
    objects = [(each.name, each.prim_path, each.category) for each in description.objects]
    assert objects == [
        ("Left", "/World/Left", "table"),
        ("Right", "/World/Right", "table"),
        ("Set", "/World/Set", "table"),  # a component, named by its first labeled part
    ]
    assert [i.object for i in description.instances] == [0, 0, 1, 1, 2, 2, 2]
    assert len(description.meshes) == 3  # the two cubes once, and the vase
    assert [i.mesh for i in description.instances] == [0, 1, 0, 1, 0, 1, 2]
    left, right = description.instances[1].world_from_object, description.instances[3].world_from_object
    np.testing.assert_allclose(left[:3, 3], (-2, -1, 0))
    np.testing.assert_allclose(right[:3, 3], (2, -2, 0))
    np.testing.assert_allclose(right @ (0, 0, 1, 0), (1, 0, 0, 0), atol=1e-9)  # a quarter turn about y takes z to x


def test_point_instances():
    description = read_stage(STAGES / "scatter.usda")
    objects = [(each.name, each.prim_path, each.category) for each in description.objects]
    assert objects == [
        ("Scatter[7]", "/World/Scatter[7]", "bush"),
        ("Scatter[9]", "/World/Scatter[9]", "bush"),
        ("Scatter[8]", "/World/Scatter[8]", ""),
    ]
    assert [i.object for i in description.instances] == [0, 0, 1, 1, 2]
    leaves, _, big_leaves, big_stem, stone = (i.world_from_object for i in description.instances)
    np.testing.assert_allclose(leaves[:3, 3], (0, 1, 100))
    np.testing.assert_allclose(big_leaves[:3, 3], (20, 3, 100))  # scaled thrice about the prototype's origin
    np.testing.assert_allclose(big_stem[:3, :3], 3 * np.eye(3))
    # The stone is at x = 1 in its prototype; scaled by (1, 2, 1), rotated by 90 degrees about z, translated by 10.
    np.testing.assert_allclose(stone[:3, 3], (10, 1, 100), atol=2e-3)  # quath holds three digits
    np.testing.assert_allclose(stone @ (0, 1, 0, 0), (-2, 0, 0, 0), atol=2e-3)


INSTANCER = """
def PointInstancer "P"
{
    rel prototypes = [</P/Ball>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0)]
    %s
    def Sphere "Ball"
    {
    }
}
"""

WRONG = [
    ("int[] protoIndices = [0, 1]", "protoIndices refer to prototype 1, but there are 1 (0-0)"),
    ("int[] protoIndices = [0, -2]", "protoIndices refer to prototype -2, but there are 1 (0-0)"),
    ("point3f[] positions = [(0, 0, 0)]", "1 positions, but 2 protoIndices"),
    ("float3[] scales = [(1, 1, 1)]", "1 scales, but 2 protoIndices"),
    ("quath[] orientations = [(1, 0, 0, 0)]", "1 orientations, but 2 protoIndices"),
    ("int64[] ids = [1, 2, 3]", "3 ids, but 2 protoIndices"),
    ("rel prototypes = [</Nowhere>]", "its prototype </Nowhere> does not exist"),
    ("rel prototypes = []", "it has no prototypes"),
    ("point3f[] positions = [(0, 0, nan), (0, 0, 0)]", "1 points, the first at 0, have a transform that is not finite"),
]


@pytest.mark.parametrize(("line", "expected"), WRONG)
def test_inconsistent_instancer_arrays_are_problems(tmp_path, line, expected):
    name = line.split(" = ")[0]
    text = "\n".join(kept for kept in INSTANCER.split("\n") if not kept.strip().startswith(name + " "))
    body = text % line if "%s" in text else text
    (problem,) = problems_of(tmp_path, body)
    assert problem.startswith(f"</P> instancer: {expected}")


def test_points_with_singular_transforms_are_not_drawn(tmp_path):
    """Scatter tools hide points that way; the others keep their ids."""
    text = "points of a point instancer whose transform is singular are not drawn: </P>"
    description = read_with_warning(tmp_path, INSTANCER % "float3[] scales = [(0, 0, 0), (1, 1, 1)]", text)
    assert [each.name for each in description.objects] == ["P[1]"]


def test_duplicate_point_ids_are_not_used(tmp_path):
    description = read_with_warning(tmp_path, INSTANCER % "int64[] ids = [4, 4]", "ids .* that are not unique are not")
    assert [each.name for each in description.objects] == ["P[0]", "P[1]"]


def test_instancer_within_its_own_prototype_is_a_problem(tmp_path):
    body = INSTANCER.replace("</P/Ball>", "</P>") % ""
    assert problems_of(tmp_path, body) == ("</P> instancer: one of its prototypes contains the instancer itself",)


def test_camera_in_a_prototype_is_reported(tmp_path):
    start = 'def Sphere "Ball"\n    {'
    body = INSTANCER.replace(start, f'{start}\n        def Camera "Eye"\n        {{\n        }}') % ""
    found = read_with_warning(tmp_path, body, "cameras in a point instancer's prototypes are not read: </P/Ball/Eye>")
    assert (len(found.objects), found.cameras) == (2, ())


def test_empty_instancer_is_reported(tmp_path):
    body = INSTANCER.replace("[0, 0]", "[]").replace("[(0, 0, 0), (1, 0, 0)]", "[]") % ""
    read_with_warning(tmp_path, body, "a point instancer without points: </P>")


def test_nested_instancer_adds_parts_to_the_outer_point(tmp_path):
    body = """
    def PointInstancer "Outer"
    {
        rel prototypes = [</Outer/Row>]
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (0, 10, 0)]
        def PointInstancer "Row"
        {
            rel prototypes = [</Outer/Row/Ball>]
            int[] protoIndices = [0, 0, 0]
            point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
            def Sphere "Ball"
            {
            }
        }
    }
    """
    description = read(tmp_path, body)
    assert [each.name for each in description.objects] == ["Outer[0]", "Outer[1]"]
    assert [i.world_from_object[:2, 3].tolist() for i in description.instances] == [
        [0, 0], [1, 0], [2, 0], [0, 10], [1, 10], [2, 10],
    ]  # fmt: skip


def test_orientationsf_take_precedence_over_orientations(tmp_path):
    lines = """
    quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0)]
    quatf[] orientationsf = [(0, 0, 0, 1), (0, 0, 0, 1)]
    """
    first, _ = read(tmp_path, INSTANCER % lines).instances
    np.testing.assert_allclose(first.world_from_object @ (1, 0, 0, 0), (-1, 0, 0, 0), atol=1e-6)  # half a turn about z


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
    class "Thing"
    {{
        {quad}
    }}
    def "A" (inherits = </Thing>
        instanceable = true)
    {{
    }}
    def "B" (inherits = </Thing>
        instanceable = true)
    {{
    }}
    """
    description = read(tmp_path, body)
    assert [each.prim_path for each in description.objects] == ["/A", "/B"]
    assert len(description.meshes) == 1


def test_instance_of_an_assembly_has_several_objects(tmp_path):
    body = """
    class "Corner" (kind = "assembly")
    {
        def Cube "Sofa"
        {
        }
        def Sphere "Lamp"
        {
        }
    }
    def "A" (inherits = </Corner>
        instanceable = true)
    {
    }
    """
    description = read(tmp_path, body)
    assert [each.prim_path for each in description.objects] == ["/A/Sofa", "/A/Lamp"]


TWO_TAXONOMIES = """
def Xform "A" (prepend apiSchemas = ["SemanticsLabelsAPI:wikidata", "SemanticsLabelsAPI:category"])
{
    token[] semantics:labels:wikidata = ["Q42177"]
    token[] semantics:labels:category = ["furniture"]
    def Cube "Bed" (prepend apiSchemas = ["SemanticsLabelsAPI:class"])
    {
        token[] semantics:labels:class = ["bed", "sleep"]
    }
    def Cube "Shelf"
    {
    }
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
        read_stage(write(tmp_path, 'def Cube "A"\n{\n}'), taxonomy="class")


def test_names_give_categories_on_stages_without_labels(tmp_path):
    body = """
def Xform "Chair_01" (kind = "component")
{
    def Cube "Seat"
    {
    }
}
def Xform "C2" (
    kind = "component"
    assetInfo = { string name = "Table-12" }
)
{
    def Cube "Top"
    {
    }
}
def Cube "Floor"
{
}
def Cube "_12"
{
}
"""
    assert [each.category for each in read(tmp_path, body).objects] == ["Chair", "Table", "Floor", "_12"]
    some = body.replace('def Cube "Floor"', 'def Cube "Floor" (prepend apiSchemas = ["SemanticsLabelsAPI:class"])')
    some = some.replace('"]\n)', '"]\n)').replace(
        'apiSchemas = ["SemanticsLabelsAPI:class"])\n{',
        'apiSchemas = ["SemanticsLabelsAPI:class"])\n{\n    token[] semantics:labels:class = ["floor"]',
    )
    assert [each.category for each in read(tmp_path, some).objects] == ["", "", "floor", ""]
    scattered = INSTANCER.replace('"Ball"', '"Ball_7"').replace("</P/Ball>", "</P/Ball_7>") % ""
    assert [each.category for each in read(tmp_path, scattered).objects] == ["Ball", "Ball"]


def test_asset_name_comes_from_asset_info_or_referenced_file(tmp_path):
    xform = 'def Xform "{}"\n{{\n    def Cube "C"\n    {{\n    }}\n}}\n'
    write(tmp_path, xform.format("Seat"), name="oak_chair.usda", more='defaultPrim = "Seat"')
    cups = xform.format("Cup") + xform.format("Dish")
    write(tmp_path, cups, name="crockery.usda", more='defaultPrim = "Cup"')
    body = """
def Xform "Set" (assetInfo = { string name = "Dining set" })
{
    def Xform "Left" (
        kind = "component"
        references = @./oak_chair.usda@)
    {
    }
    def Xform "Right" (
        kind = "component"
        instanceable = true
        payload = @./oak_chair.usda@)
    {
    }
    def Xform "Dish" (
        kind = "component"
        references = @./crockery.usda@</Dish>)
    {
    }
    def Xform "Jug" (
        kind = "component"
        assetInfo = { string name = "Jug" }
        references = @./crockery.usda@)
    {
    }
}
def Xform "Alone" (kind = "component")
{
    def Xform "Box" (references = @./crockery.usda@)
    {
    }
}
"""
    assets = {each.prim_path: each.asset for each in read(tmp_path, body).objects}
    assert assets == {
        "/Set/Left": "Oak Chair",
        "/Set/Right": "Oak Chair",
        "/Set/Dish": "Dining set",  # a part of a file is no asset
        "/Set/Jug": "Jug",
        "/Alone": "",  # assets of its parts do not count
    }
    assert read_template(tmp_path / "oak_chair.usda").description.objects[0].asset == "Oak Chair"


PARTS = """
def Xform "Chair" (kind = "component")
{
    def Cube "Seat"
    {
    }
    def Xform "Frame"
    {
        def Mesh "Legs"
        {
            uniform token subdivisionScheme = "none"
            int[] faceVertexCounts = [3, 3, 3]
            int[] faceVertexIndices = [0, 1, 2, 0, 2, 3, 0, 3, 1]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1)]
            def GeomSubset "Left"
            {
                int[] indices = [2]
            }
            def GeomSubset "Right"
            {
                int[] indices = [0]
            }
        }
    }
}
def Sphere "Ball"
{
}
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
    body = PARTS.replace(
        'def GeomSubset "Right"\n            {',
        'def GeomSubset "Right"\n            {\n                uniform token familyName = "materialBind"',
    )
    assert read(tmp_path, body).objects[0].parts == ("Seat", "Frame/Legs/Left", "Frame/Legs")


def test_template_is_one_object_with_all_parts(tmp_path):
    body = 'def Xform "Set"\n{\n' + PARTS.replace('kind = "component"', 'kind = "subcomponent"') + "}\n"
    template = read_template(write(tmp_path, body, more='defaultPrim = "Set"'))
    (each,) = template.description.objects
    assert each.parts == ("Seat", "Legs/Left", "Legs/Right", "Legs", "Ball")
    assert [(each.object, each.part) for each in template.description.instances] == [(0, 0), (0, 1), (0, 4)]


COLLIDERS = """
def Xform "Chair" (kind = "component"%s)
{
    def Cube "Drawn"
    {
    }
    def Cube "Proxy" (prepend apiSchemas = ["PhysicsCollisionAPI"])
    {
        %s
    }
}
def Cube "Wall"
{
}
def Cube "Ghost" (prepend apiSchemas = ["PhysicsCollisionAPI"])
{
    bool physics:collisionEnabled = 0
}
"""


@pytest.mark.parametrize(
    ("line", "more", "expected"),
    [
        ("", "", [False, True, True, False]),
        ("bool physics:collisionEnabled = 0", "", [True, False, True, False]),
        ("", 'def PhysicsScene "Physics"\n{\n}\n', [False, True, False, False]),
    ],
)
def test_colliders_follow_usd_physics(tmp_path, line, more, expected):
    description = read(tmp_path, COLLIDERS % ("", line) + more)
    assert [each.collides for each in description.instances] == expected


HIDDEN = """
def Xform "Chair" (kind = "component")
{
    def Cube "Drawn"
    {
    }
    def Cube "Hull" (prepend apiSchemas = ["PhysicsCollisionAPI"])
    {
        uniform token purpose = "guide"
        double3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }
}
def Cube "Pane" (prepend apiSchemas = ["PhysicsCollisionAPI"])
{
    token visibility = "invisible"
}
def Cube "Hint"
{
    uniform token purpose = "guide"
}
def Cube "Off" (prepend apiSchemas = ["PhysicsCollisionAPI"])
{
    token visibility = "invisible"
    bool physics:collisionEnabled = 0
}
def PointInstancer "Scatter"
{
    int[] protoIndices = [0, 0]
    point3f[] positions = [(5, 0, 0), (9, 0, 0)]
    rel prototypes = </Scatter/Bush>
    def Xform "Bush"
    {
        def Sphere "Drawn"
        {
        }
        def Cube "Hull" (prepend apiSchemas = ["PhysicsCollisionAPI"])
        {
            uniform token purpose = "proxy"
        }
    }
}
"""


def test_colliders_that_are_not_drawn_are_kept(tmp_path):
    description = read(tmp_path, HIDDEN)
    assert [each.name for each in description.objects] == ["Chair", "Scatter[0]", "Scatter[1]"]
    assert [(each.object, each.collides) for each in description.instances] == [(0, False), (1, False), (2, False)]
    found = {each.prim_path: each for each in description.colliders}
    assert {path: each.object for path, each in found.items()} == {
        "/Chair/Hull": 0, "/Pane": -1, "/Scatter[0]": 1, "/Scatter[1]": 2,
    }  # fmt: skip
    np.testing.assert_allclose(found["/Chair/Hull"].world_from_object, np.diag([2, 2, 2, 1]))
    np.testing.assert_allclose(found["/Scatter[1]"].world_from_object[:3, 3], (9, 0, 0))
    np.testing.assert_allclose(description.bounds(), [(-1, -1, -1), (10, 1, 1)])  # of drawn meshes only


def test_rigid_bodies_are_movable(tmp_path):
    body = COLLIDERS % (', prepend apiSchemas = ["PhysicsRigidBodyAPI"]', "")
    body = body.replace('(kind = "component", ', '(\nkind = "component"\n')
    assert [each.movable for each in read(tmp_path, body).objects] == [True, False, False]
    off = body.replace('def Cube "Drawn"', 'bool physics:rigidBodyEnabled = 0\ndef Cube "Drawn"')
    assert not read(tmp_path, off).objects[0].movable


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
