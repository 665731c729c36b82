# SPDX-License-Identifier: Apache-2.0
"""UsdSkel: linear blend skinning and blend shapes, at one time and over time."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from tests.usd.helpers import STAGES, problems_of, write
from tiscene.errors import StageWarning
from tiscene.usd.read.stage_reader import read_stage
from tiscene.usd.read.template import read_template

BENT = [(0, 0, 0), (1, 0, 0), (-1, 2, 0), (-1, 1, 0)]  # upper joint, at (0, 1), rotated by 90 degrees about z


def posed_points(path, **options):
    """Return the points of the stage's only mesh in world space."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)
        description = read_stage(path, **options)
    (instance,) = description.instances
    points = description.meshes[instance.mesh].positions
    return points @ instance.world_from_object[:3, :3].T + instance.world_from_object[:3, 3]


@pytest.mark.parametrize(
    ("time", "expected"),
    [
        (10.0, BENT),
        (0.0, [(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 0)]),
        (None, [(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 0)]),
    ],
)
def test_linear_blend_skinning_poses_mesh_at_time(time, expected):
    """The mesh is translated by 5 from its skeleton, but bound in skeleton space."""
    np.testing.assert_allclose(posed_points(STAGES / "skinned.usda", time_code=time), expected, atol=1e-6)


def test_pose_between_samples_is_slerped():
    """USD interpolates joint rotations by slerp: 45 degrees at half time."""
    root = np.sqrt(0.5)
    expected = [(0, 0, 0), (1, 0, 0), (0, 1 + 2 * root, 0), (-root, 1 + root, 0)]
    np.testing.assert_allclose(posed_points(STAGES / "skinned.usda", time_code=5.0), expected, atol=1e-6)


def test_stage_read_at_one_time_has_no_deformation():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (mesh,) = read_stage(STAGES / "skinned.usda", time_code=10.0).meshes
        assert mesh.deformation is None


def test_instances_of_one_pose_share_a_skinned_mesh(tmp_path):
    body = f"""
def "A" (instanceable = true
    prepend references = @{STAGES / "skinned.usda"}@</Arm>)
{{
}}
def "B" (instanceable = true
    prepend references = @{STAGES / "skinned.usda"}@</Arm>)
{{
    double3 xformOp:translate = (0, 0, 7)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
"""
    path = write(
        tmp_path, body.replace("(instanceable = true\n", "(\n    instanceable = true\n").replace("</Arm>)", "</Arm>\n)")
    )
    a, b = (each for each in read_stage(path, time_code=10.0).instances)
    np.testing.assert_allclose(b.world_from_object[:3, 3] - a.world_from_object[:3, 3], (0, 0, 7))
    assert a.mesh == b.mesh


def test_templates_are_posed_at_start_time(tmp_path):
    text = (STAGES / "skinned.usda").read_text().replace("startTimeCode = 0", "startTimeCode = 10")
    (tmp_path / "arm.usda").write_text(text)
    template = read_template(tmp_path / "arm.usda")
    (mesh,), (instance,) = template.description.meshes, template.description.instances
    points = mesh.positions + instance.world_from_object[:3, 3]
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [(-1, 0, 0), (1, 2, 0)], atol=1e-6)


def test_skinning_changes_no_file():
    before = (STAGES / "skinned.usda").read_bytes()
    posed_points(STAGES / "skinned.usda", time_code=10.0)
    assert (STAGES / "skinned.usda").read_bytes() == before


FACE = """
def SkelRoot "Face" (
    prepend apiSchemas = ["SkelBindingAPI"]
)
{
    rel skel:skeleton = </Face/Skel>
    rel skel:animationSource = </Face/Skel/Anim>
    def Skeleton "Skel"
    {
        uniform token[] joints = ["head"]
        uniform matrix4d[] bindTransforms = [((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))]
        uniform matrix4d[] restTransforms = [((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))]
        def SkelAnimation "Anim"
        {
            uniform token[] blendShapes = ["smile"]
            float[] blendShapeWeights.timeSamples = { 0: [0], 10: [1] }
        }
    }
    def Mesh "Skin" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        uniform token[] skel:blendShapes = ["smile"]
        rel skel:blendShapeTargets = </Face/Skin/smile>
        def BlendShape "smile"
        {
            uniform vector3f[] offsets = [(2, 0, 0), (0, 4, 0)]
            uniform int[] pointIndices = [1, 2]
            uniform vector3f[] inbetweens:half:offsets = [(3, 0, 0), (0, 0, 0)] (
                weight = 0.5
            )
        }
    }
}
"""


def test_blend_shapes_with_inbetweens_deform_over_time(tmp_path):
    """Weights grow from 0 to 1 over ten time codes; an in-between shape at 5 moves one point by 3 along x."""
    path = write(tmp_path, FACE, more="startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10")
    (mesh,) = read_stage(path).meshes
    for seconds, right, up in ((0.0, 1.0, 1.0), (0.2, 2.2, 1.0), (0.5, 4.0, 1.0), (1.0, 3.0, 5.0)):
        positions, _ = mesh.deformation.at(seconds)
        np.testing.assert_allclose(positions, [(0, 0, 0), (right, 0, 0), (0, up, 0)], atol=1e-6)
    assert mesh.deformation.at(0.6)[0][1, 0] == pytest.approx(3.8)  # between 4 and 3


def test_blend_shape_of_missing_points_is_named(tmp_path):
    wrong = FACE.replace("pointIndices = [1, 2]", "pointIndices = [1, 3]")
    text = "</Face/Skin> skinning: blend shape 'smile' moves points that do not exist"
    assert text in problems_of(tmp_path, wrong)[0]


def test_normal_offsets_of_blend_shapes_and_inbetweens_turn_the_normals(tmp_path):
    """At 5 the normal of one point has turned to (0, -0.6, 0.8), at 10 to (0, 0.6, 0.8), as USD bakes it."""
    body = FACE.replace(
        "uniform token subdiv", "normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1)]\nuniform token subdiv"
    )
    turns = "vector3f[] %snormalOffsets = [(0, %g, -0.2), (0, 0, 0)]\n"
    lines = turns % ("", 0.6) + turns % ("inbetweens:half:", -0.6)
    body = body.replace("inbetweens:half:offsets", "inbetweens:half").replace(
        "uniform int[] point", f"{lines}uniform int[] point"
    )
    path = write(tmp_path, body, more="startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10")
    (mesh,) = read_stage(path).meshes
    for seconds, expected in ((0.0, (0, 0, 1)), (0.5, (0, -0.6, 0.8)), (1.0, (0, 0.6, 0.8))):
        _, normals = mesh.deformation.at(seconds)
        np.testing.assert_allclose(normals, [(0, 0, 1), expected, (0, 0, 1)], atol=1e-6)


def test_indexing_skinned_stream_gives_same_bytes_as_iterating(tmp_path):
    import tiscene as ts

    light = 'def DistantLight "Sun"\n{\n float inputs:intensity = 3\n}\n'
    path = write(tmp_path, light + FACE, more="startTimeCode = 0\n    endTimeCode = 10\n    timeCodesPerSecond = 10")
    camera = ts.Camera(position=(1, 1, 4), exposure=0.0)
    options = {"width": 24, "height": 18, "fps": 10.0, "frames": 6, "camera": camera, "spp": 1, "denoise": False}
    buffers = ("hdr", "depth", "forward_flow", "backward_flow", "forward_occlusion", "normal")
    one, other = (ts.Stream(path, buffers=buffers, **options) for _ in range(2))
    frames = list(one)
    for k in (5, 0, 3, 3):
        for name in buffers:
            assert other[k].buffers[name].tobytes() == frames[k].buffers[name].tobytes(), (k, name)
    assert frames[3].depth.tobytes() != frames[4].depth.tobytes()


def test_stage_of_many_time_codes_is_posed_at_its_samples(tmp_path):
    path = tmp_path / "long.usda"
    path.write_text((STAGES / "skinned.usda").read_text().replace("endTimeCode = 10", "endTimeCode = 1e12"))
    (mesh,) = read_stage(path).meshes
    positions, _ = mesh.deformation.at(mesh.deformation.times[-1])
    np.testing.assert_allclose(positions - positions[0], BENT, atol=1e-6)
