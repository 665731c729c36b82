# SPDX-License-Identifier: Apache-2.0
"""Memory of this process while 20,000 small label frames are exported, for each format in a process of its own.

Run it as `python -m tests.benchmarks.export_memory [FORMAT ...]`. Resident memory is read after a twentieth of the
frames, when caches are full, at a quarter, half and three quarters, and at the end, when files of many frames have been
written. The manifest grows by a kilobyte a frame.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tiscene.export.formats import FORMATS

BUFFERS = ("semantic", "instance", "depth", "forward_flow")
FRAMES = 20_000
SHARES = (0.05, 0.25, 0.5, 0.75)


def print_table(formats: tuple[str, ...] = tuple(FORMATS), frames: int = FRAMES) -> None:
    """Print the table.

    Args:
        formats: names of formats.
        frames: number of frames of each export.
    """
    heads = "".join(f"{share:>8.0%}" for share in SHARES)
    print(f"{'format':>12}{heads}{'end':>8}{'peak':>8} MB {'s':>6}   ({frames} frames)", flush=True)
    for name in formats:
        command = [
            sys.executable,
            "-c",
            f"from tests.benchmarks.export_memory import measure; measure({name!r}, {frames})",
        ]
        subprocess.run(command, check=True)


def measure(format: str, frames: int) -> None:
    """Export frames in this process, and print the row of a format."""
    import tiscene as ts
    from tests.benchmarks.movers import bouncing_movers
    from tiscene.export import export

    buffers = BUFFERS if FORMATS[format].optional is None else FORMATS[format].buffers
    scenario = ts.Scenario("solid_benchmark", bouncing_movers(("Cube", "Sphere")))
    stream = ts.Stream(scenario, width=64, height=48, buffers=buffers, quality="preview", spp=1)
    marks = {round(share * frames) for share in SHARES}
    resident: list[int] = []

    def note(index: int, frame: ts.Frame | None) -> None:
        if index in marks:
            resident.append(_memory("VmRSS"))

    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        export(stream, folder, format=format, frames=range(frames), progress=note)
    resident.append(_memory("VmRSS"))
    cells = "".join(f"{each >> 10:>8}" for each in (*resident, _memory("VmHWM")))
    print(f"{format:>12}{cells} MB {time.perf_counter() - began:>6.0f}", flush=True)


def _memory(kind: str) -> int:
    """Return resident memory of this process (VmRSS), or the most so far (VmHWM), kB."""
    status = Path("/proc/self/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith(kind))


if __name__ == "__main__":
    print_table(tuple(sys.argv[1:]) or tuple(FORMATS))
