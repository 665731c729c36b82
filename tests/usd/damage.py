# SPDX-License-Identifier: Apache-2.0
"""Deterministic damage to USD files, and a bounded way to read many damaged files.

The undamaged files are exported from anonymous layers, so that their bytes hold no path: what is damaged depends on
neither folder, host, hash seed nor order.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

from pxr import Sdf

READ, REFUSED, STOPPED, CRASHED = "read", "refused", "stopped", "crashed"

# Reads each file in a forked child within the limits that `subprocess_worker` sets, and prints what became of it.
_PROGRAM = """
import importlib, operator, os, sys, traceback, warnings
from tiscene.errors import TisceneError
from tiscene.usd.core.limits import Limits
from tiscene.usd.read.subprocess_worker import apply_limits
module, function, seconds, *paths = sys.argv[1:]
function = operator.attrgetter(function)(importlib.import_module(module))
warnings.simplefilter("ignore")
for path in paths:
    child = os.fork()
    if child == 0:
        apply_limits(Limits(seconds=float(seconds), memory=4 << 30))
        status = 2
        try:
            function(path)
            status = 0
        except TisceneError:
            status = 1
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(status)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def crate_bytes(text: str, folder: Path, suffix: str = "usdc") -> bytes:
    """Return a layer, given as text, in the format of a suffix. The bytes do not depend on the folder."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    assert layer.ImportFromString(text)
    path = folder / f"undamaged.{suffix}"
    assert layer.Export(str(path))
    return path.read_bytes()


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return a file with 1 to 16 bits flipped; one in ten is also truncated."""
    result = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        result[rng.randrange(len(result))] ^= 1 << rng.randrange(8)
    return bytes(result[: rng.randrange(len(result))] if rng.random() < 0.1 else result)


def read_all(function: str, files: list[Path], seconds: float, total: float, crashes: bool = False) -> list[str]:
    """Read files in child processes, each within limits of time and memory.

    Args:
        function: "module:function", called with each path.
        files: the files.
        seconds: limit for one file.
        total: limit for all of them; the test fails if they take longer.
        crashes: whether USD may end the process.

    Returns:
        READ, REFUSED (a TisceneError), STOPPED (at the time limit) or CRASHED for each file. Any other error fails the
        test.
    """
    command = [sys.executable, "-c", _PROGRAM, *function.split(":"), str(seconds), *map(str, files)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True) as process:
        try:
            output, errors = process.communicate(timeout=total)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)  # the forked child as well
            raise
    codes = [int(line) for line in output.split()]
    outcomes = {0: READ, 1: REFUSED, -signal.SIGALRM: STOPPED}
    if crashes:
        outcomes |= {-signal.SIGABRT: CRASHED, -signal.SIGSEGV: CRASHED}
    assert len(codes) == len(files), errors.decode(errors="replace")[-2000:]
    assert set(codes) <= set(outcomes), errors.decode(errors="replace")[-2000:]
    return [outcomes[code] for code in codes]
