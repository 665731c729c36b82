# SPDX-License-Identifier: Apache-2.0
"""Native instances and point instances."""

from __future__ import annotations

import numpy as np
import pytest

from tests.usd.helpers import STAGES, problems_of, read, read_with_warning
from tiscene.usd.read.stage_reader import read_stage


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
def PointInstancer "P" {
    rel prototypes = [</P/Ball>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0)]
    %s
    def Sphere "Ball" {}
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
    ("point3f[] positions = [(0, 0, nan), (0, 0, 0)]", "1 point, the first at 0, with a transform that is not finite"),
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
    body = INSTANCER.replace('def Sphere "Ball" {', 'def Sphere "Ball" {\n        def Camera "Eye" {}\n') % ""
    found = read_with_warning(tmp_path, body, "cameras in a point instancer's prototypes are not read: </P/Ball/Eye>")
    assert (len(found.objects), found.cameras) == (2, ())


def test_empty_instancer_is_reported(tmp_path):
    body = INSTANCER.replace("[0, 0]", "[]").replace("[(0, 0, 0), (1, 0, 0)]", "[]") % ""
    read_with_warning(tmp_path, body, "a point instancer without points: </P>")


def test_nested_instancer_adds_parts_to_the_outer_point(tmp_path):
    body = """
    def PointInstancer "Outer" {
        rel prototypes = [</Outer/Row>]
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (0, 10, 0)]
        def PointInstancer "Row" {
            rel prototypes = [</Outer/Row/Ball>]
            int[] protoIndices = [0, 0, 0]
            point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
            def Sphere "Ball" {}
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
