# SPDX-License-Identifier: Apache-2.0
"""Templates from files and from the class prim /Templates of a stage."""

from __future__ import annotations

import numpy as np
import pytest

from tests.usd.helpers import read, write
from tiscene.errors import MissingFile, StageError, UnknownName
from tiscene.usd.read.template import read_template

CHAIR = """
def Xform "Chair" (
    kind = "component"
    prepend apiSchemas = ["SemanticsLabelsAPI:class"]
) {
    token[] semantics:labels:class = ["chair"]
    double3 xformOp:translate = (5, 6, 7)
    float3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    def Cube "Seat" {
        double3 xformOp:translate = (0, 1, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def Cube "Back" {}
}
"""
DEFAULT = 'defaultPrim = "Chair"'


def test_template_origin_is_that_of_its_prim(tmp_path):
    template = read_template(write(tmp_path, CHAIR, more=DEFAULT))
    assert template.category == "chair"
    (each,) = template.description.objects
    assert each.name == "Chair"
    seat, back = (i.world_from_object for i in template.description.instances)
    np.testing.assert_allclose(seat[:3, 3], (0, 2, 0))  # its own scale stays, its place does not
    np.testing.assert_allclose(back, np.diag([2.0, 2.0, 2.0, 1.0]))


def test_template_name_is_display_name_or_from_the_file(tmp_path):
    folder = tmp_path / "arm_chair_01"
    folder.mkdir()
    assert read_template(write(folder, CHAIR, more=DEFAULT, name="template.usda")).name == "Arm Chair 01"
    assert read_template(write(folder, CHAIR, more=DEFAULT, name="stool_02.usda")).name == "Stool 02"
    named = CHAIR.replace('kind = "component"', 'kind = "component"\n    displayName = "The Chair"')
    assert read_template(write(folder, named, more=DEFAULT, name="template.usda")).name == "The Chair"


def test_only_root_prim_is_read_without_a_default_prim(tmp_path):
    assert read_template(write(tmp_path, CHAIR)).category == "chair"
    with pytest.raises(StageError, match="no default prim"):
        read_template(write(tmp_path, CHAIR + 'def Cube "Another" {}'))


def test_only_the_default_prim_is_read(tmp_path):
    template = read_template(write(tmp_path, CHAIR + 'def Cube "Floor" {}', more=DEFAULT))
    assert len(template.description.instances) == 2


def test_template_is_converted_to_unit_and_up_axis(tmp_path):
    path = write(tmp_path, CHAIR, more=DEFAULT, meters=0.01, up="Z")
    as_it_is = read_template(path)
    assert as_it_is.description.up_axis == "Z"
    np.testing.assert_allclose(as_it_is.description.instances[0].world_from_object[:3, 3], (0, 0.02, 0))
    turned = read_template(path, up_axis="Y")
    assert turned.description.up_axis == "Y"
    np.testing.assert_allclose(turned.description.instances[0].world_from_object[:3, 3], (0, 0, -0.02), atol=1e-12)
    path = write(tmp_path, CHAIR, more=DEFAULT, name="y.usda")
    risen = read_template(path, up_axis="Z").description.instances[0].world_from_object
    np.testing.assert_allclose(risen[:3, 3], (0, 0, 2), atol=1e-12)


def test_first_labeled_part_gives_the_template_category(tmp_path):
    body = CHAIR.replace('prepend apiSchemas = ["SemanticsLabelsAPI:class"]', "").replace(
        "token[] semantics:labels:class", "token[] bogus"
    )
    body = body.replace(
        'def Cube "Back" {',
        'def Cube "Back" (prepend apiSchemas = ["SemanticsLabelsAPI:class"]) {\n'
        '        token[] semantics:labels:class = ["backrest"]\n',
    )
    assert read_template(write(tmp_path, body, more=DEFAULT)).category == "backrest"
    by_name = read_template(write(tmp_path, 'def Cube "Box_01" {}', name="box.usda"))
    assert by_name.category == "Box"  # nothing in the file has a label


VARIED = """
def Xform "Lamp" (
    kind = "component"
    variants = {
        string size = "small"
    }
    prepend variantSets = "size"
) {
    variantSet "size" = {
        "small" {
            def Cube "Shade" {
                double size = 0.1
            }
        }
        "large" {
            def Cube "Shade" {
                double size = 0.4
            }
        }
    }
}
"""


def test_template_variants_are_selected(tmp_path):
    path = write(tmp_path, VARIED)

    def width(**options):
        (mesh,) = read_template(path, **options).description.meshes
        return np.ptp(mesh.positions[:, 0])

    assert width() == pytest.approx(0.1)
    assert width(variants={"size": "large"}) == pytest.approx(0.4)
    with pytest.raises(UnknownName, match="huge"):
        read_template(path, variants={"size": "huge"})
    with pytest.raises(UnknownName, match="color"):
        read_template(path, variants={"color": "red"})


def test_files_without_a_template_raise_errors(tmp_path):
    with pytest.raises(MissingFile):
        read_template(tmp_path / "gone.usda")
    with pytest.raises(StageError, match="</Empty> template: it holds no geometry"):
        read_template(write(tmp_path, 'def Xform "Empty" {}'))


def test_children_of_the_templates_class_are_templates(tmp_path):
    body = """
    def Cube "Floor" {}
    class "Templates" {
        def Xform "Chair_01" (prepend apiSchemas = ["SemanticsLabelsAPI:class"]) {
            token[] semantics:labels:class = ["chair"]
            double3 xformOp:translate = (1, 0, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
            def Sphere "Seat" {}
        }
        def Cube "Box" (displayName = "Toy Box") {}
    }
    """
    description = read(tmp_path, body)
    assert [each.name for each in description.objects] == ["Floor"]
    chair, box = description.templates
    assert (chair.name, chair.category) == ("Chair 01", "chair")
    np.testing.assert_array_equal(chair.description.instances[0].world_from_object, np.eye(4))
    assert (box.name, box.category) == ("Toy Box", "")
    assert len(box.description.meshes) == len(box.description.materials) == 1


def test_ordinary_prim_named_templates_is_not_a_template_folder(tmp_path):
    description = read(tmp_path, 'def "Templates"\n{\ndef Cube "C" {}\n}')
    assert not description.templates
    assert [each.name for each in description.objects] == ["C"]
