# SPDX-License-Identifier: Apache-2.0
"""Import of USD files as templates: units, axes, animation, variants and broken parts."""

from __future__ import annotations

import re

import numpy as np
import pytest
from PIL import Image
from pxr import Usd

import tiscene as ts
from tests.usd.helpers import write
from tiscene.errors import StageWarning
from tiscene.usd.importers.import_template import import_asset
from tiscene.usd.read.template import read_template


def test_usd_in_centimeters_with_z_up_is_converted(tmp_path):
    body = 'def Xform "Part"\n{\n    def Cube "Box"\n    {\n        double size = 100\n'
    body += "        double3 xformOp:translate = (0, 0, 50)\n"
    body += '        uniform token[] xformOpOrder = ["xformOp:translate"]\n    }\n}\n'
    (tmp_path / "in").mkdir()
    source = write(tmp_path / "in", body, meters=0.01, up="Z", more='defaultPrim = "Part"', name="part.usda")
    path = import_asset(source, tmp_path / "out", label="crate")
    template = read_template(path)
    assert template.category == "crate"
    np.testing.assert_allclose(template.description.bounds(), [(-0.5,) * 3, (0.5,) * 3], atol=1e-6)
    standing = read_template(import_asset(source, tmp_path / "out", centered=False)).description.bounds()
    np.testing.assert_allclose(standing, [(-0.5, 0, -0.5), (0.5, 1, 0.5)], atol=1e-6)
    assert (tmp_path / "out" / "source" / "part.usda").is_file()  # a copy of the source


def test_imported_usd_animation_begins_at_the_start_of_its_file(tmp_path):
    (tmp_path / "in").mkdir()
    body = 'def Cube "Fan"\n{\n    double size.timeSamples = {0: 4, 30: 1, 60: 3}\n}\n'
    more = 'defaultPrim = "Fan"\n    startTimeCode = 30\n    endTimeCode = 60\n    timeCodesPerSecond = 30'
    path = import_asset(write(tmp_path / "in", body, name="fan.usda", more=more), tmp_path / "out")
    scenario = ts.Scenario("object_view", [ts.Object("fan", str(path), (0, 0, -9))])
    stream = ts.Stream(scenario, fps=10, width=8, height=6, buffers=("instance",))
    sizes = [np.subtract(*stream[frame].objects.by_name("fan").world_bounds[::-1]) for frame in (0, 5, 10)]
    np.testing.assert_allclose(sizes, np.outer((1, 2, 3), np.ones(3)), rtol=1e-5)


def test_variants_of_imported_usd_file_are_selectable(tmp_path):
    (tmp_path / "in").mkdir()
    variants = "".join(f'"{name}" {{\ndouble size = {size}\n}}\n' for name, size in (("small", 0.2), ("large", 0.4)))
    body = f'def Cube "Box" (\n    prepend variantSets = "size"\n)\n{{\n    variantSet "size" = {{\n{variants}}}\n}}\n'
    source = write(tmp_path / "in", body, meters=1.0, more='defaultPrim = "Box"', name="box.usda")
    path = import_asset(source, tmp_path / "out", name="Crate 01")
    for variant, width in (("small", 0.2), ("large", 0.4)):
        low, high = read_template(path, variants={"size": variant}).description.bounds()
        np.testing.assert_allclose(high - low, [width] * 3)
    assert Usd.Stage.Open(str(path)).GetDefaultPrim().GetVariantSet("size").GetVariantSelection() == ""


def test_usd_file_with_broken_parts_is_imported_without_them(tmp_path):
    """A texture that does not exist, an endless point instancer, and a transform that USD cannot read."""
    folder = tmp_path / "in"
    folder.mkdir()
    Image.new("RGB", (2, 2)).save(folder / "there.png")
    prims = """def Xform "Box"
{
    asset gone = @gone.png@
    asset there = @there.png@
    def Cube "Shape"
    {
    }
    def PointInstancer "Endless"
    {
        int[] protoIndices = [0]
        point3f[] positions = [(9, 0, 0)]
        rel prototypes = </Box/Endless>
    }
    def Cube "Bad"
    {
        uniform token[] xformOpOrder = ["xformOp:foo"]
        double3 xformOp:foo = (9, 0, 0)
    }
}"""
    path = write(folder, prims, more='defaultPrim = "Box"')
    with pytest.warns(
        StageWarning, match=r"files that do not exist are not copied into the template: <gone\.png>"
    ) as caught:
        file = import_asset(path, tmp_path / "out")
    for text in ("</Box/Endless> instancer: one of its prototypes", "</Box/Bad> cannot be read: .*'foo'"):
        assert re.search(text, str(caught[0].message))
    assert caught[0].filename == __file__
    assert (tmp_path / "out" / "source" / "0" / "there.png").is_file()
    with pytest.warns(StageWarning):
        np.testing.assert_allclose(read_template(file).description.bounds(), [[-1] * 3, [1] * 3], atol=1e-6)


LAMP = """def Xform "Lamp"
{
    def SphereLight "Bulb"
    {
        bool inputs:normalize = 1
        float inputs:intensity = 30000
        float inputs:radius = 4
    }
    def Slab "Base"
    {
        double size = 10
    }
}"""


def test_what_a_scale_does_not_convert_of_an_imported_usd_file_is_converted(tmp_path):
    (tmp_path / "in").mkdir()
    more = 'defaultPrim = "Lamp"\n    fallbackPrimTypes = {\n        token[] Slab = ["Cube"]\n    }'
    source = write(tmp_path / "in", LAMP, meters=0.01, up="Z", more=more, name="lamp.usda")
    (own,) = read_template(source).description.lights
    template = read_template(import_asset(source, tmp_path / "out", name="Lamp 01")).description
    (light,) = template.lights
    assert light.radius == pytest.approx(own.radius) == pytest.approx(0.04)
    assert light.radiance == pytest.approx(own.radiance)
    assert len(template.instances) == 1  # the Slab is a Cube


def test_file_in_meters_is_referenced_as_it_is(tmp_path):
    (tmp_path / "in").mkdir()
    source = write(tmp_path / "in", LAMP, meters=1.0, more='defaultPrim = "Lamp"', name="lamp.usda")
    stage = Usd.Stage.Open(str(import_asset(source, tmp_path / "out")))
    assert not stage.GetRootLayer().GetPrimAtPath("/Lamp/Source/Asset").nameChildren
