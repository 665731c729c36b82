# SPDX-License-Identifier: Apache-2.0
"""Public names of `dynamics`, and the cost of importing it."""

import os
import subprocess
import sys

import pytest

import dynamics


def loaded_modules(code: str) -> set[str]:
    """Return the names of the modules that are loaded after running `code` in a new process."""
    program = f"{code}\nimport sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_dir_lists_exactly_the_public_names():
    assert dir(dynamics) == sorted(dynamics.__all__)
    assert dynamics.__all__ == sorted(dynamics.__all__, key=lambda name: (name.islower(), name))


@pytest.mark.parametrize("name", dynamics.__all__)
def test_every_public_name_exists_and_has_a_docstring(name):
    value = getattr(dynamics, name)
    assert value.__doc__
    assert value is getattr(dynamics, name)


def test_unknown_name_raises_attribute_error():
    with pytest.raises(AttributeError, match="module 'dynamics' has no attribute 'Waypiont'"):
        dynamics.Waypiont  # noqa: B018


def test_importing_the_package_or_its_errors_loads_neither_numpy_nor_taichi():
    assert not {"numpy", "taichi"} & loaded_modules("import dynamics, dynamics.errors, dynamics.argument_checks")


def test_describing_trajectories_does_not_load_taichi():
    code = "import dynamics as d; d.CatmullWaypoints([d.Waypoint((0, 0, 0)), d.Waypoint((1, 0, 0))]); d.cover"
    assert "taichi" not in loaded_modules(code)


@pytest.mark.skipif(os.name != "posix", reason="Taichi needs HOME on POSIX only")
def test_package_alone_works_without_home():
    """Taichi would abort the process."""
    code = (
        "import dynamics; dynamics.Simulation; import taichi as ti; ti.init(ti.cpu, offline_cache=False); print('ok')"
    )
    environment = {name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1:] == ["ok"], done.stderr
