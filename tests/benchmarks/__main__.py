"""Tables of speed: `python -m tests.benchmarks [NAME ...]`. They assert nothing.

Each module of this folder with a `main()` is one benchmark; without names all of them run, in the order of their names.
"""

import importlib
import os
import pkgutil
import platform
import sys
import time
from collections.abc import Callable

from tests import benchmarks
from tiscene import device


def found() -> dict[str, Callable[[], None]]:
    """The benchmarks by name."""
    modules = {
        module.name: importlib.import_module(f"{benchmarks.__name__}.{module.name}")
        for module in pkgutil.iter_modules(benchmarks.__path__)
        if not module.name.startswith("_")
    }
    return {name: module.main for name, module in sorted(modules.items()) if hasattr(module, "main")}


def main(wanted: list[str]) -> int:
    """Run them; returns the exit status."""
    known = found()
    unknown = [name for name in wanted if name not in known]
    if unknown:
        print(f"no benchmark {unknown[0]!r}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    arch = device.start()
    print(f"{platform.machine()}, {os.cpu_count()} logical cores, Python {platform.python_version()}, Taichi on {arch}")
    for name in wanted or known:
        print(f"\n{name}: {(sys.modules[known[name].__module__].__doc__ or '').splitlines()[0]}")
        began = time.perf_counter()
        known[name]()
        print(f"({time.perf_counter() - began:.0f} s)", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
