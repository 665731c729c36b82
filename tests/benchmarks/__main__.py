# SPDX-License-Identifier: Apache-2.0
"""Print tables of speed: `python -m tests.benchmarks [--large] [--scene SCENE] [NAME ...]`. They assert nothing.

Each module of this folder with a `main()` is one benchmark. Without names all of them run, in alphabetical order.
--large measures at 640x480 instead of 256x192, where a benchmark has one size. --scene selects one of the scenes of
`stills` and `path`; it may be given several times. Tables go to stdout, messages to stderr.
A peer renderer that is not installed is omitted.
"""

import argparse
import importlib
import inspect
import os
import pkgutil
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tests import benchmarks
from tiscene.device import runtime
from tiscene.errors import DeviceError


def discover() -> dict[str, Callable[..., None]]:
    """Return the main functions of the benchmarks by name."""
    modules = {
        module.name: importlib.import_module(f"{benchmarks.__name__}.{module.name}")
        for module in pkgutil.iter_modules(benchmarks.__path__)
        if not module.name.startswith("_")
    }
    return {name: module.main for name, module in sorted(modules.items()) if hasattr(module, "main")}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run benchmarks.

    Args:
        arguments: the command line; None for this process's.

    Returns:
        The exit status: 0, 2 for an unknown name, 130 after Ctrl-C.
    """
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description="Tables of speed.")
    parser.add_argument("names", metavar="NAME", nargs="*", help="benchmarks to run (default: all)")
    parser.add_argument(
        "--large", action="store_true", help="640x480 instead of 256x192, where a benchmark has one size"
    )
    parser.add_argument("--scene", metavar="SCENE", action="append", help="only this scene, in stills and path")
    args = parser.parse_args(arguments)
    known = discover()
    unknown = [name for name in args.names if name not in known]
    if unknown:
        print(f"no benchmark {unknown[0]!r}; known: {', '.join(known)}", file=sys.stderr)
        return 2
    arch = runtime.start()
    print(f"{platform.machine()}, {os.cpu_count()} logical cores, Python {platform.python_version()}, Taichi on {arch}")
    try:
        for name in args.names or known:
            run(name, known[name], {"large": args.large, "scenes": args.scene})
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


def run(name: str, benchmark: Callable[..., None], options: Mapping[str, Any]) -> None:
    """Run one benchmark, with those of the options that it takes, and print how long it took."""
    print(f"\n{name}: {(sys.modules[benchmark.__module__].__doc__ or '').splitlines()[0]}", flush=True)
    taken = inspect.signature(benchmark).parameters
    began = time.perf_counter()
    try:
        benchmark(**{option: value for option, value in options.items() if value and option in taken})
    except (ModuleNotFoundError, DeviceError) as error:
        print(f"{name} is omitted: {error}. Install what it needs: pip install -e '.[benchmark]'", file=sys.stderr)
    print(f"({time.perf_counter() - began:.0f} s)", flush=True)


if __name__ == "__main__":
    sys.exit(main())
