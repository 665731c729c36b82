# SPDX-License-Identifier: Apache-2.0
"""The schema: registered with USD, in step with the Python classes, shipped in the package."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys

import pytest
from pxr import Sdf

import dynamics
import tiscene as ts
from tiscene.errors import StageError, StageWarning
from tiscene.usd.core import schema
from tiscene.usd.scenario.motion_schema import CLASS_BY_TYPE, KEYS_BY_CLASS, PARAMETERS, STEPPED


def test_importing_the_reader_registers_the_schema():
    code = (
        "import tiscene.usd.read.stage_reader\nfrom pxr import Usd\nregistry = Usd.SchemaRegistry()\n"
        "for name in ('Scenario', 'Object', 'Motion', 'Joint', 'Camera'):\n"
        "    print(len(registry.FindAppliedAPIPrimDefinition(f'Tiscene{name}API').GetPropertyNames()))\n"
        "stage = Usd.Stage.CreateInMemory()\nprim = stage.DefinePrim('/Thing', 'Xform')\n"
        "prim.AddAppliedSchema('TisceneMotionAPI')\n"
        "print(prim.GetAppliedSchemas(), prim.GetAttribute('tiscene:motion:totalTime').Get())"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *counts, applied = output.stdout.splitlines()
    assert sum(map(int, counts)) == len(schema.properties())
    assert applied == "['TisceneMotionAPI'] 10.0"
    assert not output.stderr


def test_objects_are_found_where_the_process_has_used_usd_before_tiscene():
    code = (
        "from pxr import Usd\nstage = Usd.Stage.CreateInMemory()\nprim = stage.DefinePrim('/Thing', 'Xform')\n"
        "prim.AddAppliedSchema('TisceneObjectAPI')\nfrom tiscene.usd.core import schema\nschema.register()\n"
        "print([schema.has(prim, name) for name in (schema.OBJECT, schema.MOTION)])"
    )
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert output.stdout == "[True, False]\n"


def test_plugin_info_and_schema_layer_list_the_same_schemas():
    types = json.loads((schema.FOLDER / "plugInfo.json").read_text())["Plugins"][0]["Info"]["Types"]
    layer = Sdf.Layer.OpenAsAnonymous(str(schema.FOLDER / "generatedSchema.usda"))
    assert set(types) == set(schema.NAMESPACES) == {prim.name for prim in layer.rootPrims}
    for name, namespace in schema.NAMESPACES.items():
        prim = layer.GetPrimAtPath(f"/{name}")
        assert prim.documentation
        for each in prim.properties:
            assert each.name.startswith(namespace + ":")
            assert each.documentation, each.path


def test_every_trajectory_field_has_a_schema_attribute():
    layer = Sdf.Layer.OpenAsAnonymous(str(schema.FOLDER / "generatedSchema.usda"))
    prim = layer.GetPrimAtPath(f"/{schema.MOTION}")
    kinds = prim.attributes["tiscene:motion:type"].allowedTokens
    assert set(kinds) == {"none", *CLASS_BY_TYPE, STEPPED}
    for name, keys in KEYS_BY_CLASS.items():
        cls = getattr(dynamics, name)
        assert {field.name for field in dataclasses.fields(cls)} == set(keys)
        for field in dataclasses.fields(cls):
            if field.name not in PARAMETERS:
                continue
            attribute = prim.attributes[f"tiscene:motion:{PARAMETERS[field.name]}"]
            # An attribute that is not authored has the class's default: the schema must not state another.
            if field.default is not dataclasses.MISSING and attribute.default is not None:
                default = attribute.default
                assert (
                    tuple(default) if hasattr(default, "__len__") and not isinstance(default, str) else default
                ) == (field.default)


@pytest.mark.parametrize("name", ["generatedSchema.usda", "plugInfo.json"])
def test_schema_files_are_in_the_package(name):
    import tiscene.usd.core

    assert schema.FOLDER.parent == type(schema.FOLDER)(tiscene.usd.core.__file__).parent
    assert (schema.FOLDER / name).is_file()


TYPED = """#usda 1.0
def Cube "Box" (prepend apiSchemas = ["TisceneMotionAPI"]) {{
    {line}
}}
"""


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('uniform string tiscene:object:firstFrame = "x"', "firstFrame is of the type string; it must be int64"),
        (
            "uniform float[] tiscene:motion:positions = [1]",
            r"positions is of the type float\[\]; it must be point3d\[\]",
        ),
        ("uniform double tiscene:motion:parts = 1", "parts is of the type double; it must be relationship"),
        ("rel tiscene:motion:speed = </Box>", "speed is of the type relationship; it must be double"),
    ],
)
def test_properties_of_another_type_are_refused(tmp_path, line, message):
    """A string in place of a number was an object that silently stood still."""
    (tmp_path / "stage.usda").write_text(TYPED.format(line=line))
    with pytest.raises(StageError, match=f"</Box> schema: tiscene:(object|motion):{message}"):
        ts.Scenario.load(tmp_path / "stage.usda")


def test_numbers_of_another_precision_are_read_and_time_samples_named(tmp_path):
    lines = 'uniform token tiscene:motion:type = "orbit"\nuniform float tiscene:motion:period = 4\n'
    samples = "double3 tiscene:motion:center.timeSamples = {0: (1, 0, 0)}"
    (tmp_path / "stage.usda").write_text(TYPED.format(line=lines + samples))
    with pytest.warns(StageWarning, match="time samples of tiscene:motion:center are ignored"):
        (box,) = ts.Scenario.load(tmp_path / "stage.usda").objects
    assert box.dynamic == ts.Orbit(period=4)
