# SPDX-License-Identifier: Apache-2.0
"""Reading stages: errors, variants, time codes, composition."""

from __future__ import annotations

import subprocess
import sys
import warnings

import numpy as np
import pytest
from pxr import Usd

from tests.usd.helpers import QUAD, read, read_with_warning, write
from tiscene.errors import ArgumentError, MissingFile, StageError, StageWarning, UnknownName
from tiscene.usd.read.stage_reader import read_stage


def test_missing_file_raises_missing_file(tmp_path):
    with pytest.raises(MissingFile, match=r"nowhere\.usda does not exist"):
        read_stage(tmp_path / "nowhere.usda")
    with pytest.raises(FileNotFoundError, match="is not a file"):
        read_stage(tmp_path)


def test_file_that_is_not_usd_raises_stage_error(tmp_path):
    path = tmp_path / "text.usda"
    path.write_text("#usda 1.0\ndef Mesh 'M' { int x = }")
    with pytest.raises(StageError, match=r"has 1 problem:\n  cannot be read: .*text\.usda:2:16: Expected }"):
        read_stage(path)
    path.write_text("#usda 1.0\ndef Mesh 'M' {\n float x.timeSamples = { 0: [1, 2 }\n}")
    with pytest.raises(StageError, match=r"text\.usda:3:\d+: syntax error at '}' in </M\.x>"):
        read_stage(path)
    path = tmp_path / "noise.usdc"
    path.write_bytes(bytes(range(256)) * 8)
    with pytest.raises(StageError, match="cannot be read"):
        read_stage(path)
    path = tmp_path / "picture.png"
    path.write_bytes(b"\x89PNG")
    with pytest.raises(StageError, match="cannot be read"):
        read_stage(path)


def test_bytes_that_are_not_utf8_raise_stage_error(tmp_path):
    path = tmp_path / "latin.usda"
    path.write_bytes(b'#usda 1.0\ndef Mesh "M\xe9\xff" { int x = \xfe }')
    with pytest.raises(StageError):
        read_stage(path)


def test_usd_diagnostics_stay_off_the_terminal(tmp_path):
    write(
        tmp_path,
        'def "A" (references = @./missing.usda@) {}\ndef Mesh "M"\n{\n    int bogus = 3\n}',
        name="bad.usda",
    )
    write(tmp_path, f'def Mesh "M"\n{{\n{QUAD}\n}}', name="good.usda")
    code = (
        "import sys\nfrom tiscene.usd.read.stage_reader import read_stage\n"
        "for name in ('bad.usda', 'good.usda'):\n"
        "    try:\n        read_stage(sys.argv[1] + '/' + name)\n    except ValueError:\n        pass\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_changed_file_is_read_again(tmp_path):
    assert len(read(tmp_path, 'def Cube "A" {}').objects) == 1
    first = read(tmp_path, 'def Cube "A" {}')
    assert len(read(tmp_path, 'def Cube "A" {}\ndef Cube "B" {}').objects) == 2
    assert first.name == "stage"


def test_changed_file_that_needs_fewer_layers_is_read_while_a_stage_holds_it(tmp_path):
    names = "ABCDEFGH"
    for name in names:
        write(tmp_path, f'def Cube "{name}" {{}}', name=f"{name}.usda")
    path = write(tmp_path, "", more=f"subLayers = [{', '.join(f'@./{name}.usda@' for name in names)}]")
    held = Usd.Stage.Open(str(path))
    assert [each.name for each in read(tmp_path, 'def Cube "Alone" {}').objects] == ["Alone"]
    assert held.GetPrimAtPath("/Alone")


VARIANTS = """
def Xform "Room" (
    variants = { string lighting = "day" }
    prepend variantSets = ["lighting", "style"]
) {
    variantSet "lighting" = {
        "day" {
            def Cube "Sun" {}
        }
        "night" {
            def Cube "Moon" {}
        }
    }
    variantSet "style" = {
        "plain" {}
    }
}
"""


def test_missing_file_is_reported_before_its_missing_variant(tmp_path):
    path = write(tmp_path, 'def "A" (references = @./missing.usda@) {}')
    with pytest.raises(StageError, match=r"</A> composition: .*missing\.usda"):
        read_stage(path, variants={"/A{color}": "red"})


def test_unknown_variant_is_named_beside_broken_parts_of_other_prims(tmp_path):
    path = write(tmp_path, VARIANTS + 'def "Miss" (references = @nope.usda@) {}\n')
    with pytest.raises(UnknownName, match=r"no variant 'x' in </Room>\{lighting\}\. There are: day, night\."):
        read_stage(path, variants={"/Room{lighting}": "x"})
    with pytest.raises(StageError, match=r"nope\.usda"):
        read_stage(path, variants={"/Miss/Lamp{lighting}": "x"})


def test_selected_variants_are_read(tmp_path):
    path = write(tmp_path, VARIANTS)
    before = path.read_bytes()

    def names(variants):
        return [each.name for each in read_stage(path, variants=variants).objects]

    assert names(None) == ["Sun"]
    assert names({"/Room{lighting}": "night"}) == ["Moon"]
    assert names({"/Room": {"lighting": "night", "style": "plain"}}) == ["Moon"]
    assert names({}) == ["Sun"]  # the selection lives in its stage alone
    assert path.read_bytes() == before


def test_variants_within_variants_are_selected_in_any_order(tmp_path):
    """`Scenario.sample` and recipes sort them."""
    inner = VARIANTS.replace("Room", "Lamp")
    body = f'def Xform "A" (\n prepend variantSets = "v"\n) {{\n variantSet "v" = {{\n "x" {{\n{inner}\n}}\n}}\n}}\n'
    path = write(tmp_path, body)
    both = {"/A/Lamp{lighting}": "night", "/A{v}": "x"}
    for variants in (both, dict(reversed(both.items()))):
        assert [each.name for each in read_stage(path, variants=variants).objects] == ["Moon"]


WRONG_VARIANTS = [
    ({"/Room{lightning}": "night"}, UnknownName, "no variant set 'lightning' on </Room>. Did you mean 'lighting'?"),
    ({"/Room{lighting}": "x"}, UnknownName, "no variant 'x' in </Room>{lighting}. There are: day, night."),
    ({"/Hall{lighting}": "night"}, UnknownName, "no prim '/Hall'"),
    ({"/Room": "night"}, ArgumentError, "'/Room' must name a variant set"),
    ({"Room!{lighting}": "night"}, ArgumentError, "'Room!' is not the path of a prim"),
    (["night"], ArgumentError, "must be a mapping"),
    ({"/Room": 3}, ArgumentError, "'/Room': 3 must be the name of a variant"),
    ({"/Room": {"lighting": 3}}, ArgumentError, "must be the name of a variant"),
    ({3: "night"}, ArgumentError, "3 must be the path of a prim"),
]


@pytest.mark.parametrize(("variants", "error", "text"), WRONG_VARIANTS)
def test_invalid_variants_raise_errors(tmp_path, variants, error, text):
    path = write(tmp_path, VARIANTS)
    with pytest.raises(error) as caught:
        read_stage(path, variants=variants)
    assert text in str(caught.value)


ANIMATED = """
def Cube "C" {
    double3 xformOp:translate.timeSamples = { 10: (1, 0, 0), 20: (3, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    token visibility.timeSamples = { 10: "inherited", 30: "invisible" }
}
"""


@pytest.mark.parametrize(("time_code", "x"), [(10, 1.0), (np.float32(15), 2.0), (25.5, 3.0), (None, 1.0)])
def test_attributes_are_read_at_the_time_code(tmp_path, time_code, x):
    path = write(tmp_path, ANIMATED)
    (instance,) = read_stage(path, time_code=time_code).instances
    assert instance.world_from_object[0, 3] == x


@pytest.mark.parametrize("time_code", [float("nan"), float("inf"), 10**400, "12", [1.0]])
def test_invalid_time_code_raises_argument_error(tmp_path, time_code):
    with pytest.raises(ArgumentError, match=r"time_code=.*: must be a finite number"):
        read_stage(write(tmp_path, ANIMATED), time_code=time_code)


def test_start_of_the_range_is_the_default_time_code(tmp_path):
    path = write(tmp_path, ANIMATED, more="startTimeCode = 20\n endTimeCode = 40")
    assert read_stage(path).instances[0].world_from_object[0, 3] == 3.0
    assert not read_stage(path, time_code=30).instances


def test_omissions_are_listed_once_in_one_warning(tmp_path):
    body = """
    def NurbsCurves "Hair" {}
    def NurbsCurves "Fur" {}
    def HermiteCurves "Dust" {}
    def NurbsPatch "Patch" {}
    def Volume "Smoke" {}
    def Volume "Fire" (prepend apiSchemas = ["VolumeLightAPI"]) {}
    def MyFancyGprim "Fancy" {}
    def Scope "Fine" {}
    def "Typeless" {}
    """
    path = write(tmp_path, body)
    with pytest.warns(StageWarning) as caught:
        read_stage(path)
    (warning,) = caught
    assert str(warning.message) == (
        f"{path} is not drawn quite as authored:\n"
        "  prims of type NurbsCurves are not drawn: </Hair>, </Fur>\n"
        "  prims of type HermiteCurves are not drawn: </Dust>\n"
        "  prims of type NurbsPatch are not drawn: </Patch>\n"
        "  prims of type Volume are not drawn: </Smoke>, </Fire>\n"
        "  prims of the unknown type MyFancyGprim are not drawn: </Fancy>"
    )


@pytest.mark.parametrize(
    "kind", ["HoudiniLayerInfo", "OmniGraphNode", "RealityKitComponent", "Preliminary_Behavior", "MjcTendon"]
)
def test_prims_in_which_other_programs_keep_their_data_are_not_named(tmp_path, kind):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(tmp_path, f'def Cube "C" {{}}\ndef {kind} "Data" {{}}')


def test_long_lists_of_problems_are_truncated(tmp_path):
    body = "".join(f'def Volume "P{i}" {{}}\n' for i in range(9))
    read_with_warning(tmp_path, body, r"<\/P4> and 4 more$")


@pytest.mark.parametrize(
    ("root", "skeleton", "reason"),
    [
        ("SkelRoot", "", "neither it nor a prim above it has a skel:skeleton"),
        ("SkelRoot", "rel skel:skeleton = </R/Gone>", "there is no Skeleton at its skel:skeleton </R/Gone>"),
        ("Xform", "", "it is not below a SkelRoot"),
    ],
)
def test_skinned_mesh_without_its_skeleton_is_reported(tmp_path, root, skeleton, reason):
    lines = f'int[] primvars:skel:jointIndices = [0, 0, 0, 0] (interpolation = "vertex")\n{skeleton}'
    body = f'def {root} "R" {{\ndef Mesh "M" (prepend apiSchemas = ["SkelBindingAPI"]) {{{QUAD}{lines}\n}}\n}}'
    assert len(read_with_warning(tmp_path, body, f"without its skinning, since {reason}: </R/M>").instances) == 1


def test_mesh_whose_blend_shapes_have_no_skeleton_is_reported(tmp_path):
    lines = 'uniform token[] skel:blendShapes = ["smile"]\nrel skel:blendShapeTargets = </M/smile>'
    lines += '\ndef BlendShape "smile"\n{\nuniform vector3f[] offsets = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)]\n}'
    body = f'def Mesh "M" (prepend apiSchemas = ["SkelBindingAPI"])\n{{\n{QUAD}\n{lines}\n}}'
    text = "a mesh with blend shapes is drawn without them, since it is not below a SkelRoot: </M>"
    assert read_with_warning(tmp_path, body, text).meshes[0].positions[:, 2].max() == 0.0


def test_empty_stage_is_valid(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not read(tmp_path, "").instances


def test_payloads_references_and_sublayers_compose(tmp_path):
    write(tmp_path, 'def Xform "Box"\n{\ndef Cube "C" {}\n}', name="box.usda", more='defaultPrim = "Box"')
    write(tmp_path, 'def Sphere "Ball" {}', name="under.usda")
    body = 'def "A" (references = @./box.usda@) {}\ndef "B" (payload = @./box.usda@) {}'
    description = read(tmp_path, body, more="subLayers = [@./under.usda@]")
    assert [each.prim_path for each in description.objects] == ["/Ball", "/A/C", "/B/C"]
    assert description.instances[1].mesh == description.instances[2].mesh


def test_description_is_named_by_file_or_folder(tmp_path):
    assert read(tmp_path, "", name="kitchen.usda").name == "kitchen"
    folder = tmp_path / "room_07"
    folder.mkdir()
    assert read(folder, "", name="scene.usda").name == "room_07"


def test_prims_of_unknown_types_are_read_as_the_fallback_that_the_stage_names(tmp_path):
    body = """
    def FancyBall "Ball" {
        double radius = 2
    }
    def FancyLight "Lamp" {
        float inputs:width = 3
    }
    """
    types = 'token[] FancyBall = ["FancierBall", "Sphere"]\ntoken[] FancyLight = ["RectLight"]'
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        description = read(tmp_path, body, more=f"fallbackPrimTypes = {{\n{types}\n}}")
    assert np.ptp(description.meshes[0].positions, axis=0) == pytest.approx(4.0, abs=0.02)
    (lamp,) = description.lights
    assert lamp.width == 3.0
