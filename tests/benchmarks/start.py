# SPDX-License-Identifier: Apache-2.0
"""The first picture of `room_02` in a new process, from starting Python to the frame.

"cold": an empty kernel cache; "warm": what the same line has left there. Each line is a process of its own. Mitsuba is
given the room in matte materials as arrays, which it need not read from USD; its kernels are cached as well.
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

from tests.benchmarks import living_room, peers

SIZE = (256, 192)
SPP, DEPTH = 4, 4
LABELS = "buffers=('semantic', 'instance', 'depth', 'forward_flow')"
# name, arguments of the stream, the frame
KINDS = (
    ("labels", LABELS, "stream[0]"),
    ("fast", "quality='fast', frames=1", "stream[0]"),
    ("preview", "quality='preview', frames=1", "stream[0]"),
    ("standard", "quality='standard', frames=1", "stream[0]"),
    ("preview, incremental", "quality='preview'", "next(stream)"),
)
SILENT = "import signal; signal.signal(signal.SIGINT, signal.SIG_DFL)\n"  # Ctrl-C is for the one who waits
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
        room.write_bytes(pickle.dumps(living_room.room(0, matte=True).description))
        row(f"Mitsuba LLVM, {SPP} spp", MITSUBA.format(*SIZE, DEPTH, SPP, SPP), str(room))


def row(name: str, code: str, *arguments: str) -> None:
    """One line: the same code twice, the first time without compiled kernels; never with a base image."""
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
    """Wall time and that of the children's CPUs, s."""
    began, before = time.perf_counter(), os.times()
    run()
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return [time.perf_counter() - began, cpu]


if __name__ == "__main__":
    main()
