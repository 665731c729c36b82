# SPDX-License-Identifier: Apache-2.0
"""`tiscene inspect`: the report on a file."""

from __future__ import annotations

import json

import pytest

from tests.usd.helpers import STAGES, write
from tests.usd.importers.test_import_template import BOX
from tiscene.cli import main as cli
from tiscene.usd.read.inspection import stage_facts

TINY = """
def Xform "Room" (
    variants = { string light = "off" }
    prepend variantSets = "light"
) {
    def Cube "Box" {
        double size = 5
    }
    def Volume "Smoke" {}
    variantSet "light" = {
        "off" {}
        "on" {
            def SphereLight "Bulb" {}
        }
    }
}
"""


def inspected(capsys, *words) -> str:
    """Return the output of `tiscene inspect`."""
    assert cli.main(["inspect", *map(str, words)]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    return captured.out


def test_report_on_a_stage(tmp_path, capsys):
    path = write(tmp_path, TINY, meters=0.01)
    out = inspected(capsys, path)
    for line in (
        "1 layer, 0.01 m per unit, Y up",
        "3 prims, 0 of them instances: 1 Xform, 1 Cube, 1 Volume",
        "variants /Room{light}: [off], on",
        "labels: none; names of prims are used instead",
        "0.05 x 0.05 x 0.05 m",
        "12 triangles in 1 mesh, placed 1 time: 12",
        "1 object: 1 Box",
        "prims of type Volume are not drawn: </Room/Smoke>",
        "the scene is 5 cm long (metersPerUnit is 0.01)",
        "there is no light",
        "there is no camera",
    ):
        assert line in out
    lit = inspected(capsys, path, "--variant", "/Room{light}=on")
    assert "1 light: 1 SphereLight" in lit
    assert "there is no light" not in lit


def test_report_on_an_empty_stage_and_on_one_far_from_the_origin(tmp_path, capsys):
    path = tmp_path / "a.usda"
    path.write_text("#usda 1.0\n")
    out = inspected(capsys, path)
    assert "0 prims, 0 of them instances\n" in out
    assert "0 objects\n" in out
    assert "there is no geometry to render" in out
    path.write_text(
        '#usda 1.0\n(\n    metersPerUnit = 1\n)\ndef Cube "A"\n{\n    double3 xformOp:translate = (4e6, 0, 0)\n'
        '    uniform token[] xformOpOrder = ["xformOp:translate"]\n}\n'
    )
    assert "the scene is far from the origin" in inspected(capsys, path)


def test_report_on_a_stage_without_a_unit(tmp_path, capsys):
    path = tmp_path / "a.usda"
    path.write_text('#usda 1.0\ndef Cube "A" {}\n')
    out = inspected(capsys, path)
    assert "0.01 m per unit (unauthored)" in out
    assert "2 cm long (metersPerUnit is 0.01, USD's default, since the file has none)" in out


PHYSICS = """#usda 1.0
def PhysicsScene "Physics" {}
def Cube "Falls" (prepend apiSchemas = ["TisceneObjectAPI", "PhysicsRigidBodyAPI"]) {}
def Cube "Stands" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) {}
def PhysicsFixedJoint "Joint" {}
"""


def test_report_counts_the_rigid_bodies_that_are_not_simulated(tmp_path, capsys):
    path = tmp_path / "a.usda"
    path.write_text(PHYSICS)
    assert "not simulated: 1 rigid body, 1 joint" in inspected(capsys, path)
    path.write_text(PHYSICS.replace('["PhysicsRigid', '["TisceneObjectAPI", "PhysicsRigid'))
    assert "not simulated" not in inspected(capsys, path)


def test_report_on_an_untrusted_file_is_of_the_rendered_content_alone(capsys):
    out = inspected(capsys, STAGES / "scatter.usda", "--untrusted")
    assert out.lstrip().startswith("Rendered (read in ")
    assert "Nothing is left out." in out


def test_report_on_an_imported_model_has_its_license(tmp_path, capsys):
    (tmp_path / "box.obj").write_text(BOX)
    assert cli.main(["import", str(tmp_path / "box.obj"), "-o", str(tmp_path), "--license", "CC0\nmore"]) == 0
    capsys.readouterr()
    out = inspected(capsys, tmp_path / "templates" / "box" / "template.usda")
    assert "license: CC0 ..." in out
    assert "1 movable object" in out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["{stage}", "--root", "{empty}"], "is outside"),
        (["{stage}", "--taxonomy", "x"], "no taxonomy 'x'"),
        (["{stage}", "--variant", "/Room{{x}}=y"], "no variant set 'x'"),
        (["gone.usda"], "no file 'gone.usda'"),
    ],
)
def test_user_errors_have_status_2_and_a_message(words, expected, tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    names = {"stage": write(tmp_path, TINY), "empty": tmp_path / "empty"}
    assert cli.main(["inspect", *(word.format(**names) for word in words)]) == 2
    assert expected in capsys.readouterr().err


def test_report_counts_animated_and_deforming_meshes(tmp_path, capsys):
    body = """
def Xform "Mill" (kind = "component") {
    def Sphere "Head" {
        double radius.timeSamples = { 0: 1, 10: 2 }
    }
    def Cube "Wing" {
        float xformOp:rotateZ.timeSamples = { 0: 0, 10: 90 }
        uniform token[] xformOpOrder = ["xformOp:rotateZ"]
    }
}
"""
    assert "1 deforming mesh; 1 animated mesh within objects" in inspected(capsys, write(tmp_path, body))


GOOD = """def Xform "Room" {
    def Mesh "Floor" {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)]
    }
    def Camera "C" {
        double3 xformOp:translate = (0, 1, 4)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def DistantLight "L" {
        float inputs:intensity = 1
    }
}
"""
MISSING = 'def "A" (references = @./missing.usda@) {}\n'
VOLUME = 'def Volume "Smoke" {}\n'


@pytest.mark.parametrize(
    ("body", "verdict"),
    [
        (GOOD, "Verdict: rendered as authored."),
        (GOOD + MISSING, "Verdict: rendered, with 1 kind of broken part left out."),
        (GOOD + VOLUME, "Verdict: rendered, with 1 kind of content approximated or not drawn."),
        ('def Cube "A" {}\n', "Verdict: rendered, with 2 things to check."),
        ("", "Verdict: nothing to see; the stage has no geometry that is drawn."),
    ],
)
def test_report_ends_with_a_verdict(tmp_path, capsys, body, verdict):
    assert inspected(capsys, write(tmp_path, body)).splitlines()[-1] == verdict


def test_refused_stage_has_a_verdict_and_an_error(tmp_path, capsys):
    path = write(tmp_path, GOOD + MISSING)
    assert cli.main(["inspect", "--strict", str(path)]) == 2
    captured = capsys.readouterr()
    assert captured.out.splitlines()[-1] == "Verdict: refused, for 1 problem."
    assert "missing.usda" in captured.err


def test_report_as_json(tmp_path, capsys):
    report = json.loads(inspected(capsys, "--json", write(tmp_path, GOOD + MISSING + VOLUME)))
    assert report["verdict"].startswith("Verdict: rendered, with 1 kind of broken part left out, 1 kind")
    assert report["refused"] is False
    assert report["facts"]["unauthored_schemes"] == 1
    assert any("missing.usda" in line for line in report["left_out"])
    assert cli.main(["inspect", "--json", str(write(tmp_path, MISSING))]) == 2
    report = json.loads(capsys.readouterr().out)
    assert report["refused"] is True
    assert "missing.usda" in report["problems"][0]


def test_report_names_meshes_that_are_smooth_by_default(tmp_path, capsys):
    out = inspected(capsys, write(tmp_path, GOOD))
    assert "1 mesh without an authored subdivisionScheme: smooth surfaces, by USD's default" in out


def test_layers_in_other_units_are_named(tmp_path, capsys):
    content = "\n".join(f'def "{name}" (references = @{name}.usda@</Box>) {{}}' for name in ("chair", "same"))
    for name, head in (("chair", 'metersPerUnit = 0.01\nupAxis = "Z"'), ("same", "metersPerUnit = 1")):
        (tmp_path / f"{name}.usda").write_text(f'#usda 1.0\n( {head} )\ndef Cube "Box" {{}}\n')
    out = inspected(capsys, write(tmp_path, content))
    (line,) = (line for line in out.splitlines() if "not converted" in line)
    assert line.startswith("  not converted to these units by USD: ")
    assert line.endswith("chair.usda (0.01 m per unit, Z up)")


def test_layers_are_in_the_order_of_their_names(tmp_path):
    names = [f"part_{number}.usda" for number in (7, 2, 9, 4, 0, 5)]
    for name in names:
        (tmp_path / name).write_text('#usda 1.0\n( metersPerUnit = 0.5 )\ndef Cube "Box" {}\n')
    content = "\n".join(f'def "{name[:6]}" (references = @{name}@</Box>) {{}}' for name in names)
    facts = stage_facts(write(tmp_path, content))
    assert len(facts.layers) == len(names) + 1
    assert len(facts.other_units) == len(names)
    for listed in (facts.layers, facts.other_units):
        assert list(listed) == sorted(listed)
