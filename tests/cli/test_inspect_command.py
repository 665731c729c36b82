# SPDX-License-Identifier: Apache-2.0
"""`tiscene inspect`: what it says of a file."""

from __future__ import annotations

import pytest

from tests.usd.helpers import STAGES, write
from tests.usd.importers.test_import_template import BOX
from tiscene.cli import main as cli

TINY = """
def Xform "Room" (
    variants = { string light = "off" }
    prepend variantSets = "light"
)
{
    def Cube "Box"
    {
        double size = 5
    }
    def Volume "Smoke"
    {
    }
    variantSet "light" = {
        "off" {
        }
        "on" {
            def SphereLight "Bulb"
            {
            }
        }
    }
}
"""


def inspected(capsys, *words) -> str:
    assert cli.main(["inspect", *map(str, words)]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


def test_what_is_said_of_a_stage(tmp_path, capsys):
    path = write(tmp_path, TINY, meters=0.01)
    out = inspected(capsys, path)
    for line in (
        "1 layer, 0.01 m a unit, Y up",
        "3 prims, 0 of them instances: 1 Xform, 1 Cube, 1 Volume",
        "variants /Room{light}: [off], on",
        "labels: none, so that names stand for them",
        "0.05 x 0.05 x 0.05 m",
        "12 triangles in 1 mesh, placed 1 time: 12",
        "1 thing: 1 Box",
        "prims of type Volume are not drawn: </Room/Smoke>",
        "everything together is 5 cm long (metersPerUnit is 0.01)",
        "there is no light",
        "there is no camera",
    ):
        assert line in out
    lit = inspected(capsys, path, "--variant", "/Room{light}=on")
    assert "1 light: 1 SphereLight" in lit
    assert "there is no light" not in lit


def test_an_empty_file_and_one_that_is_far_away(tmp_path, capsys):
    path = tmp_path / "a.usda"
    path.write_text("#usda 1.0\n")
    out = inspected(capsys, path)
    assert "0 prims, 0 of them instances\n" in out
    assert "0 things\n" in out
    assert "there is nothing to see" in out
    path.write_text(
        '#usda 1.0\n(\n    metersPerUnit = 1\n)\ndef Cube "A"\n{\n    double3 xformOp:translate = (4e6, 0, 0)\n'
        '    uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    )
    assert "everything is far from the origin" in inspected(capsys, path)


def test_a_file_that_does_not_say_its_unit(tmp_path, capsys):
    path = tmp_path / "a.usda"
    path.write_text('#usda 1.0\ndef Cube "A"\n{\n}\n')
    out = inspected(capsys, path)
    assert "0.01 m a unit (unauthored)" in out
    assert "2 cm long (metersPerUnit is 0.01, USD's default: the file does not say)" in out


def test_a_file_that_is_not_trusted(capsys):
    out = inspected(capsys, STAGES / "scatter.usda", "--untrusted")
    assert out.lstrip().startswith("Rendered (read in ")
    assert "Nothing is left out." in out


def test_an_imported_model_tells_its_license(tmp_path, capsys):
    (tmp_path / "box.obj").write_text(BOX)
    assert cli.main(["import", str(tmp_path / "box.obj"), "-o", str(tmp_path), "--license", "CC0\nmore"]) == 0
    capsys.readouterr()
    out = inspected(capsys, tmp_path / "templates" / "box" / "template.usda")
    assert "license: CC0 ..." in out
    assert "1 movable thing" in out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["{stage}", "--root", "{empty}"], "is outside"),
        (["{stage}", "--taxonomy", "x"], "no taxonomy 'x'"),
        (["{stage}", "--variant", "/Room{{x}}=y"], "no variant set 'x'"),
        (["gone.usda"], "no file 'gone.usda'"),
    ],
)
def test_mistakes(words, expected, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    names = {"stage": write(tmp_path, TINY), "empty": tmp_path / "empty"}
    assert cli.main(["inspect", *(word.format(**names) for word in words)]) == 2
    assert expected in capsys.readouterr().err


def test_what_plays_is_counted(tmp_path, capsys):
    body = """
def Xform "Mill" (
    kind = "component"
)
{
    def Sphere "Head"
    {
        double radius.timeSamples = { 0: 1, 10: 2 }
    }
    def Cube "Wing"
    {
        float xformOp:rotateZ.timeSamples = { 0: 0, 10: 90 }
        uniform token[] xformOpOrder = ["xformOp:rotateZ"]
    }
}
"""
    assert "1 mesh that deform; 1 mesh that move in their things" in inspected(capsys, write(tmp_path, body))
