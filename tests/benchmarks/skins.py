# SPDX-License-Identifier: Apache-2.0
"""Reading of skinned characters and computing their vertices on demand: time and memory.

"long": 59 meshes of one skeleton over 3,385 samples. "crowd": 500 instances of one character over 240 samples.
"stages": 500 stages, read one after another in one process. Each is measured in a process of its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.usd.characters import author_character

READ = """
import json, resource, sys, time, warnings
from tiscene.usd.read.stage_reader import read_stage
def resident():
    pages = int(open("/proc/self/statm").read().split()[1])
    return pages * resource.getpagesize() / 2**20
warnings.simplefilter("ignore")
path, count = sys.argv[1], int(sys.argv[2])
early = None
before = resident()
began = time.process_time()
for number in range(count):
    stage = read_stage(path)
    if number == count // 10:
        early = resident()
read = (time.process_time() - began) / count
after = resident()
skins = [mesh.deformation for mesh in stage.meshes if mesh.deformation is not None]
began = time.process_time()
for frame in range(5):
    for skin in skins:
        skin.sample(frame)
shape = (time.process_time() - began) / 5
print(json.dumps([len(stage.instances), len(skins), read, shape * 1e3, after - before, after - early]))
"""


def main() -> None:
    """Print the table."""
    header = ("placed", "skins", "read, CPU s", "all shapes, CPU ms", "memory, MiB", "of it late, MiB")
    print(f"{'':8}" + "".join(f"{name:>20}" for name in header))
    with tempfile.TemporaryDirectory() as folder:
        long = author_character(Path(folder, "long.usdc"), samples=3385, meshes=59, rings=32, scheme="catmullClark")
        one = author_character(Path(folder, "one.usdc"), samples=240, normals=True)
        crowd = Path(folder, "crowd.usda")
        copies = "".join(
            f'def "C{number}" (\n instanceable = true\n references = @{one}@\n)\n{{\n'
            f'double3 xformOp:translate = ({number}, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n}}\n'
            for number in range(500)
        )
        crowd.write_text(f"#usda 1.0\n(\n endTimeCode = 239\n startTimeCode = 0\n metersPerUnit = 0.01\n)\n{copies}")
        for name, path, count in (("long", long, 1), ("crowd", crowd, 1), ("stages", one, 500)):
            command = [sys.executable, "-c", READ, str(path), str(count)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            placed, skins, read, shape, memory, late = json.loads(done.stdout)
            print(f"{name:8}{placed:20,}{skins:20,}{read:20.2f}{shape:20.1f}{memory:20.0f}{late:20.1f}")


if __name__ == "__main__":
    main()
