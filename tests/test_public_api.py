# SPDX-License-Identifier: Apache-2.0
"""Public names of `tiscene`, and the cost of importing it."""

import importlib
import importlib.metadata
import re
import subprocess
import sys

import pytest

import tiscene

PUBLIC = [
    "AllTogether",
    "Camera",
    "CameraOverride",
    "CatmullWaypoints",
    "Clock",
    "Composite",
    "Course",
    "DictTimings",
    "DistanceJoint",
    "FixedJoint",
    "Frame",
    "Frustum",
    "Keyframes",
    "LensKeyframes",
    "LightMotion",
    "LightOverride",
    "Limits",
    "LinearWaypoints",
    "LookAt",
    "MaterialOverride",
    "Object",
    "ObjectOverride",
    "Orbit",
    "Phase",
    "PrismaticJoint",
    "RevoluteJoint",
    "RigidBody",
    "Scenario",
    "SphericalJoint",
    "Stepped",
    "Still",
    "Stream",
    "Supervision",
    "TisceneError",
    "UniformMovementRandomBounce",
    "WaitUntilComplete",
    "Waypoint",
    "World",
    "categories",
    "distributed",
    "evaluate",
    "scenes",
    "templates",
]


def python(code: str) -> str:
    """Run a program in a new process and return its output."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_public_names_are_exactly_those_listed():
    assert tiscene.__all__ == ["__version__", *PUBLIC]
    assert dir(tiscene) == sorted(tiscene.__all__)


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_documented(name):
    value = getattr(tiscene, name)
    assert callable(value) or name == "distributed"  # a module
    assert value.__doc__
    assert value is getattr(tiscene, name)


@pytest.mark.parametrize("name", [name for name in PUBLIC if name != "distributed"])
def test_docstrings_of_public_names_refer_to_public_names(name):
    """`help` of a joint referred to a class that `ts` does not have; others are given with their modules."""
    referred = re.findall(r"[Ss]ee `([A-Z]\w+)", getattr(tiscene, name).__doc__)
    assert set(referred) <= set(PUBLIC)


def test_unknown_name_raises_attribute_error():
    with pytest.raises(AttributeError, match="has no attribute 'Steram'; did you mean 'Stream'"):
        tiscene.Steram  # noqa: B018


def test_version_matches_package_metadata():
    assert tiscene.__version__ == importlib.metadata.version("tiscene")


def test_import_loads_no_dependency_and_few_modules():
    modules = python("import sys, tiscene; print(*sys.modules)").split()
    assert not {"taichi", "pxr", "numpy", "PIL", "rich", "trimesh", "OpenEXR"} & set(modules)
    assert len([name for name in modules if name.startswith("tiscene")]) < 5


def test_building_a_scenario_loads_neither_taichi_nor_pxr():
    """A scenario can be written on a machine that cannot render it."""
    modules = python(
        "import sys, tiscene as ts\n"
        "ts.Scenario('anywhere', [ts.Object('c', 'Cube', dynamic=ts.LinearWaypoints([ts.Waypoint((0, 0, 0)), "
        "ts.Waypoint((1, 0, 0))]))], timings=ts.AllTogether(0.5), camera=ts.Camera())\n"
        "print(*sys.modules)"
    ).split()
    assert not {"taichi", "pxr"} & set(modules)


def test_help_loads_no_dependency():
    modules = python(
        "import sys, contextlib, tiscene.cli.main\n"
        "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(None):\n"
        "    tiscene.cli.main.main(['render', '--help'])\n"
        "print(*sys.modules)"
    ).split()
    assert not {"taichi", "pxr", "numpy", "PIL", "rich"} & set(modules)


@pytest.mark.parametrize(
    "name",
    [
        *("dynamics", "tiscene", "tiscene.export", "tiscene.export.distributed", "tiscene.learning"),
        *("tiscene.sailenv", "tiscene.usd"),
    ],
)
def test_names_that_are_imported_at_first_use_are_listed_and_kept(name):
    package = importlib.import_module(name)
    assert set(dir(package)) >= set(package.__all__)
    last = package.__all__[-1]
    assert getattr(package, last) is vars(package)[last]
    with pytest.raises(AttributeError, match=f"module '{name}' has no attribute '{last}s'; did you mean '{last}'"):
        getattr(package, last + "s")
