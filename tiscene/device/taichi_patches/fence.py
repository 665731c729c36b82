# SPDX-License-Identifier: Apache-2.0
"""Which code the patches of Taichi apply to, and whether they are on.

The patches apply to kernels and functions that are defined in `tiscene` or `dynamics`, and to array copies that these
packages ask for. They are off if the environment variable ``TISCENE_TAICHI_PATCHES`` is "0", and for a version of
Taichi that they were not written for. On a GPU, kernels are launched and arrays copied as on a CPU, but compiled by
Taichi's own front end: CUDA's compiler reorders sums, and differently if a kernel is built in fewer steps. "1" turns
the patched front end on there.
"""

from __future__ import annotations

import functools
import os
import warnings

import taichi as ti

PINNED_VERSION = (1, 7, 4)
SWITCH = "TISCENE_TAICHI_PATCHES"

_packages = {"tiscene", "dynamics"}


@functools.cache
def enabled() -> bool:
    """Return whether the patches are on. Warn, once, if they are off because of Taichi's version."""
    if os.environ.get(SWITCH) == "0":
        return False
    if tuple(ti.__version__) != PINNED_VERSION:
        expected, found = (".".join(map(str, version)) for version in (PINNED_VERSION, ti.__version__))
        warnings.warn(
            f"Taichi {found} is installed, but tiscene's faster launches and compilation are for Taichi {expected}. "
            f"tiscene runs without them: slower, with the same results. To get them, install taichi=={expected}; "
            f"to silence this warning, set {SWITCH}=0",
            RuntimeWarning,
            stacklevel=2,
        )
        return False
    return True


def compiles_here() -> bool:
    """Return whether the patched front end is on for the backend that Taichi runs on."""
    return ti.cfg.arch in (ti.x64, ti.arm64) or os.environ.get(SWITCH) == "1"


def include(package: str) -> None:
    """Patch the kernels of one more top-level package from now on. For this project's own tests."""
    _packages.add(package)


def is_inside(module: str | None) -> bool:
    """Return whether a module, given by its full name, belongs to the patched packages."""
    return module is not None and module.partition(".")[0] in _packages
