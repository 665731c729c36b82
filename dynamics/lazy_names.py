# SPDX-License-Identifier: Apache-2.0
"""Public names of packages, imported at first use, so that importing a package loads little."""

import importlib
import sys
from collections.abc import Mapping
from typing import Any


def import_name(package: str, modules: Mapping[str, str], name: str) -> Any:
    """Return a public name of a package, and keep it there; for the package's `__getattr__`.

    Args:
        package: Full name of the package.
        modules: Full name of the module that defines each public name, or is it.
        name: The name that is looked up.

    Raises:
        AttributeError: The package has no such name.
    """
    if name not in modules:
        from dynamics.errors import did_you_mean

        raise AttributeError(f"module {package!r} has no attribute {name!r}{did_you_mean(name, modules)}")
    module = importlib.import_module(modules[name])
    value = module if module.__name__.endswith(f".{name}") else getattr(module, name)
    setattr(sys.modules[package], name, value)
    return value
