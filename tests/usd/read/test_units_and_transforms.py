# SPDX-License-Identifier: Apache-2.0
"""Units, axes and transforms of stages."""

from __future__ import annotations

import numpy as np
import pytest

from tests.usd.helpers import QUAD, problems_of, read, read_with_warning, write
from tiscene.errors import StageError, StageWarning
from tiscene.usd.read.stage_reader import read_stage


def places(description) -> dict[str, np.ndarray]:
    """Return world matrices by object name."""
    return {description.objects[i.object].name: i.world_from_object for i in description.instances}


@pytest.mark.parametrize("meters", [1000.0, 1.0, 0.01])
def test_lengths_become_meters(tmp_path, meters):
    body = """
    def Xform "X" {
        double3 xformOp:translate = (1, 2, 3)
        float3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
        def Cube "C" {
            double size = 4
        }
    }
    """
    description = read(tmp_path, body, meters=meters)
    (instance,) = description.instances
    np.testing.assert_allclose(instance.world_from_object[:3, 3], np.array([1, 2, 3]) * meters)
    np.testing.assert_allclose(instance.world_from_object[:3, :3], 2 * np.eye(3))
    np.testing.assert_allclose(description.meshes[0].positions.max(axis=0), np.full(3, 2 * meters), rtol=1e-6)


def test_meters_per_unit_is_a_centimeter_unless_authored(tmp_path):
    path = tmp_path / "bare.usda"
    path.write_text('#usda 1.0\ndef Cube "C" {}\n')
    np.testing.assert_allclose(read_stage(path).meshes[0].positions.max(), 0.01)


def test_invalid_unit_is_replaced_by_the_default(tmp_path):
    path = write(tmp_path, 'def Cube "C" {}', meters=-1.0)
    with pytest.warns(StageWarning, match="metersPerUnit is -1; USD's default of 0.01 m is used"):
        assert read_stage(path).bounds()[1].tolist() == pytest.approx([0.01, 0.01, 0.01])
    with pytest.raises(StageError, match="metersPerUnit is -1"):
        read_stage(path, strict=True)


def test_description_keeps_the_stage_axes(tmp_path):
    assert read(tmp_path, 'def Cube "C" {}', up="Y").up_axis == "Y"
    description = read(tmp_path, 'def Cube "C" {}', up="Z", name="z.usda")
    assert description.up_axis == "Z"
    np.testing.assert_array_equal(description.instances[0].world_from_object, np.eye(4))


def test_transforms_nest_and_reset(tmp_path):
    body = """
    def Xform "A" {
        double3 xformOp:translate = (10, 0, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Xform "B" {
            float xformOp:rotateZ = 90
            uniform token[] xformOpOrder = ["xformOp:rotateZ"]
            def Cube "Nested" {
                double3 xformOp:translate = (1, 0, 0)
                double3 xformOp:translate:p = (0, 0, 5)
                uniform token[] xformOpOrder = [
                    "xformOp:translate", "xformOp:translate:p", "!invert!xformOp:translate:p"
                ]
            }
            def Cube "Reset" {
                double3 xformOp:translate = (1, 0, 0)
                uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"]
            }
        }
    }
    """
    at = places(read(tmp_path, body))
    # A point (1, 0, 0) of the cube: +(1, 0, 0), then a quarter turn about z, then +(10, 0, 0).
    np.testing.assert_allclose(at["Nested"] @ (1, 0, 0, 1), (10, 2, 0, 1), atol=1e-9)
    np.testing.assert_allclose(at["Reset"][:3, 3], (1, 0, 0))


SCALED = 'def Cube "C"\n{\nfloat3 xformOp:scale = %s\nuniform token[] xformOpOrder = ["xformOp:scale"]\n}'


def test_invalid_transforms_are_problems(tmp_path):
    (problem,) = problems_of(tmp_path, SCALED % "(1, nan, 1)")
    assert problem.startswith("</C> transform: its transform holds numbers that are not finite")
    (problem,) = problems_of(tmp_path, SCALED % "(1, 1e30, 1)")
    assert problem == "</C> transform: its transform holds numbers above 1e+18"


def test_flattened_geometry_is_reported(tmp_path):
    """Some programs hide objects by a scale of 0."""
    text = "geometry that its transform flattens is not drawn: </C>"
    assert not read_with_warning(tmp_path, SCALED % "(1, 0, 1)", text).instances


@pytest.mark.parametrize(
    ("body", "meters"),
    [
        (f'def Mesh "C"\n{{{QUAD.replace("(1, 1, 0)", "(1, 1e38, 0)")}}}', 100.0),
        ('def Sphere "C"\n{\ndouble radius = 1e300\n}', 1.0),
    ],
)
def test_coordinates_beyond_single_precision_are_problems(tmp_path, body, meters):
    path = write(tmp_path, body, meters=meters)
    with pytest.raises(
        StageError, match=r"</C> (geometry: its points reach farther than 1e|sphere: radius is 1e\+300)"
    ):
        read_stage(path)


def test_mirrored_transforms_are_kept(tmp_path):
    body = 'def Cube "C"\n{\nfloat3 xformOp:scale = (-1, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]\n}'
    assert np.linalg.det(read(tmp_path, body).instances[0].world_from_object[:3, :3]) == pytest.approx(-1.0)
