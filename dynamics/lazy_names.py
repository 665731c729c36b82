# SPDX-License-Identifier: Apache-2.0
"""Public names of packages, imported at first use, so that importing a package loads little."""

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def lazy_names(
    package: str, modules: Mapping[str, Sequence[str]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package whose public names are imported at first use.

    Args:
        package: Full name of the package.
        modules: The public names that each module defines, by the module's full name. A module is public itself if its
            own name is among them.
    """
    module_of = {name: module for module, names in modules.items() for name in names}
    public = sorted(module_of)

    def import_name(name: str) -> Any:
        if name not in module_of:
            from dynamics.errors import did_you_mean

            raise AttributeError(f"module {package!r} has no attribute {name!r}{did_you_mean(name, module_of)}")
        module = importlib.import_module(module_of[name])
        value = module if module.__name__.endswith(f".{name}") else getattr(module, name)
        setattr(sys.modules[package], name, value)
        return value

    return import_name, lambda: public, public
