# SPDX-License-Identifier: Apache-2.0
"""What `import tiscene` gives, and what it costs."""

import importlib.metadata
import subprocess
import sys

import pytest

import tiscene

PUBLIC = [
    "AllTogether",
    "Camera",
    "CatmullWaypoints",
    "Composite",
    "DictTimings",
    "Frame",
    "Frustum",
    "Keyframes",
    "LightMotion",
    "LinearWaypoints",
    "LookAt",
    "Object",
    "Orbit",
    "Scenario",
    "Stepped",
    "Still",
    "Stream",
    "TisceneError",
    "UniformMovementRandomBounce",
    "WaitUntilComplete",
    "Waypoint",
    "World",
]


def python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_exactly_these_names_are_public():
    assert tiscene.__all__ == ["__version__", *PUBLIC]
    assert set(PUBLIC) <= set(dir(tiscene))


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_is_there_and_documented(name):
    value = getattr(tiscene, name)
    assert isinstance(value, type)
    assert value.__doc__
    assert value is getattr(tiscene, name)


def test_no_other_name_is_there():
    with pytest.raises(AttributeError, match="module 'tiscene' has no attribute 'Steram'"):
        tiscene.Steram  # noqa: B018


def test_the_version_is_that_of_the_package():
    assert tiscene.__version__ == importlib.metadata.version("tiscene")


def test_importing_is_instant_and_starts_nothing():
    report = python(
        "import time; began = time.perf_counter(); import tiscene; took = time.perf_counter() - began\n"
        "import sys; print(took, *sorted({name.split('.')[0] for name in sys.modules}))"
    ).split()
    assert float(report[0]) < 0.5
    assert not {"taichi", "pxr", "numpy", "PIL", "rich", "trimesh", "OpenEXR"} & set(report[1:])


def test_names_of_the_scenario_need_no_taichi():
    """Writing down what is to happen is possible on a machine that could not render it."""
    modules = python(
        "import sys, tiscene as ts\n"
        "ts.Scenario('anywhere', [ts.Object('c', 'Cube', dynamic=ts.LinearWaypoints([ts.Waypoint((0, 0, 0)), "
        "ts.Waypoint((1, 0, 0))]))], timings=ts.AllTogether(0.5), camera=ts.Camera())\n"
        "print(*sys.modules)"
    ).split()
    assert not {"taichi", "pxr"} & set(modules)


def test_help_is_instant_and_starts_nothing():
    modules = python(
        "import sys, contextlib, tiscene.cli\n"
        "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(None):\n"
        "    tiscene.cli.main(['render', '--help'])\n"
        "print(*sys.modules)"
    ).split()
    assert not {"taichi", "pxr", "numpy", "PIL", "rich"} & set(modules)
