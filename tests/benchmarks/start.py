# SPDX-License-Identifier: Apache-2.0
"""Start-up time: the first picture of `room_02` in a new process, from starting Python to the frame.

"cold": empty kernel cache. "warm": the cache that the cold run of the same line has left. Each run is a process of its
own. Mitsuba receives the matte room as arrays, without reading USD; its kernels are cached as well.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from tests.benchmarks import peers, shipped_rooms

SIZE = (256, 192)
SPP, DEPTH = 4, 4
LABELS = "buffers=('semantic', 'instance', 'depth', 'forward_flow')"
# Name of the line, arguments of the stream, expression for the frame.
KINDS = (
    ("labels", LABELS, "stream[0]"),
    ("fast", "quality='fast', incremental=False", "stream[0]"),
    ("preview", "quality='preview', incremental=False", "stream[0]"),
    ("standard", "quality='standard'", "stream[0]"),
    ("preview, incremental", "quality='preview'", "stream[0]"),
)
# Ctrl-C ends the child without a traceback.
SILENT = "import signal; signal.signal(signal.SIGINT, signal.SIG_DFL)\n"
OURS = "import tiscene as ts; stream = ts.Stream('room_02', width={}, height={}, {}); {}"
MITSUBA = """
import pickle, sys
import mitsuba as mi
import numpy as np
mi.set_variant("llvm_ad_rgb")
from tests.reference import mitsuba_scene
room = pickle.loads(open(sys.argv[1], "rb").read())
scene = mitsuba_scene.scene(mi, room, room.cameras[0], {}, {}, max_depth={}, spp={})
np.array(mi.render(scene, spp={}))
"""


def main() -> None:
    """Print the table."""
    print(f"{'':>24} {'cold, s':>8} {'CPU':>6} {'warm, s':>8} {'CPU':>6}  ({SIZE[0]}x{SIZE[1]})")
    for name, arguments, frame in KINDS:
        row(name, OURS.format(*SIZE, arguments, frame))
    if peers.mitsuba() is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder, "room")
        room.write_bytes(pickle.dumps(shipped_rooms.living_room(0, matte=True).description))
        row(f"Mitsuba LLVM, {SPP} spp", MITSUBA.format(*SIZE, DEPTH, SPP, SPP), str(room))


def row(name: str, code: str, *arguments: str) -> None:
    """Run code twice, first with an empty kernel cache, and print one line. Base images are never cached."""
    command = [sys.executable, "-c", SILENT + code, *arguments]
    with tempfile.TemporaryDirectory() as kernels:
        times: list[float] = []
        for _ in range(2):
            with tempfile.TemporaryDirectory() as images:
                caches = {"TI_OFFLINE_CACHE_FILE_PATH": kernels, "HOME": kernels, "TISCENE_CACHE": images}
                times += measured(partial(subprocess.run, command, env=os.environ | caches, check=True))
    cold, cold_cpu, warm, warm_cpu = times
    print(f"{name:>24} {cold:8.1f} {cold_cpu:6.1f} {warm:8.1f} {warm_cpu:6.1f}", flush=True)


def measured(run: Callable[[], object]) -> list[float]:
    """Return the wall time of a function and the CPU time of its child processes, s."""
    began, before = time.perf_counter(), os.times()
    run()
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return [time.perf_counter() - began, cpu]


if __name__ == "__main__":
    main()
