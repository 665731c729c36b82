# SPDX-License-Identifier: Apache-2.0
"""Check tiscene on a GPU: `python -m tests.gpu [PART ...] [--arch cuda] [--scenes FOLDER] [--scale S]`.

One program that runs to its end whatever fails. Each part runs in a process of its own with a limit of time, and prints
its lines as it goes; the last line counts what failed. It needs taichi, numpy and the files of `python -m
tests.gpu.bake` only, so that a machine without a package index can run it. docs/dev/gpu.md says what to carry there, in
which order to run the parts, and what a failure means.
"""

import argparse
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from tests.gpu.baked_scene import FOLDER_NAME
from tests.gpu.parts import PARTS

ONE = "--one"
MARKS = {None: "    ", True: "ok  ", False: "FAIL"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run parts and return the number of failures, at most 99.

    Args:
        arguments: the command line; None for this process's.
    """
    parser = argparse.ArgumentParser(prog="python -m tests.gpu", description="Check tiscene on a GPU.")
    parser.add_argument("parts", metavar="PART", nargs="*", help=f"of {', '.join(PARTS)} (default: all)")
    parser.add_argument("--arch", default="cuda", choices=("cuda", "cpu"), help="backend of Taichi (default: cuda)")
    parser.add_argument("--scenes", type=Path, default=Path(FOLDER_NAME), help="folder of the baked scenes")
    parser.add_argument("--scale", type=float, help="fraction of the full work (default: 1, on the CPU 0.02)")
    parser.add_argument("--limits", type=float, default=1.0, help="factor on the limits of time (default: 1)")
    parser.add_argument(ONE, action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args(arguments)
    unknown = [name for name in args.parts if name not in PARTS]
    if unknown:
        parser.error(f"no part {unknown[0]!r}; known: {', '.join(PARTS)}")
    scale = args.scale or (1.0 if args.arch == "cuda" else 0.02)
    os.environ["TISCENE_GPU_SCENES"] = str(args.scenes.resolve())
    if args.one:
        return _run_here(args.parts[0], args.arch, args.scenes, scale)
    began, failed = time.perf_counter(), 0
    for name in args.parts or PARTS:
        print(f"\n{name}: {(PARTS[name][0].__doc__ or '').splitlines()[0]}", flush=True)
        failed += _run_apart(name, args.arch, args.scenes, scale, args.limits)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = used.ru_utime + used.ru_stime
    print(f"\n{failed} failed, {time.perf_counter() - began:.0f} s, {cpu:.0f} s of CPU time", flush=True)
    return min(failed, 99)


def _run_apart(name: str, arch: str, scenes: Path, scale: float, factor: float) -> int:
    """Run a part in a process of its own and return the number of its failures."""
    command = [sys.executable, "-m", "tests.gpu", name, "--arch", arch, "--scenes", str(scenes), "--scale", str(scale)]
    began, limit = time.perf_counter(), factor * PARTS[name][1]
    process = subprocess.Popen([*command, ONE])
    try:
        status = process.wait(limit)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        print(f"FAIL  longer than {limit:.0f} s", flush=True)
        return 1
    except BaseException:
        process.kill()
        raise
    if status < 0 or status > 99:
        print(f"FAIL  ended with status {status}", flush=True)
    print(f"      ({time.perf_counter() - began:.0f} s)", flush=True)
    return status if 0 <= status <= 99 else 1


def _run_here(name: str, arch: str, folder: Path, scale: float) -> int:
    """Run a part in this process and return the number of its failures."""
    from tests.gpu.baked_scene import load
    from tiscene.device import runtime

    failed = 0
    try:
        runtime.start(arch)
        for check in PARTS[name][0](load(folder), scale):
            failed += check.passed is not None and not check.passed  # it may be a bool of NumPy
            print(f"{MARKS[check.passed]}  {check.what}: {check.found}", flush=True)
    except Exception as error:  # the next parts still run
        print(f"FAIL  {type(error).__name__}: {error}", flush=True)
        failed += 1
    return failed


if __name__ == "__main__":
    sys.exit(main())
