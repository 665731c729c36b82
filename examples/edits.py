# SPDX-License-Identifier: Apache-2.0
"""Edit a running stream, save the scenario with its edits, and replay the same bytes.

python examples/edits.py
"""

import argparse
import tempfile
from pathlib import Path

import tiscene as ts

arguments = argparse.ArgumentParser(description="Edit a running stream and replay it.")
arguments.add_argument("--width", type=int, default=128)
args = arguments.parse_args()

settings = {"width": args.width, "height": args.width * 3 // 4, "frames": 12, "buffers": ("instance", "depth")}
stream = ts.Stream("solid_benchmark", **settings)
seen = []
for frame in stream:
    seen.append(frame)
    if frame.index == 3:
        ball = stream.world.spawn("Ball 01", position=(0.0, 1.0, -2.5))
        print(f"frame {stream.position}: object {ball} appears")
    if frame.index == 6:
        stream.world.move(ball, position=(0.6, 1.0, -2.5))
        print(f"frame {stream.position}: it moves")
    if frame.index == 9:
        stream.world.despawn(ball)
        print(f"frame {stream.position}: it is gone")

with tempfile.TemporaryDirectory() as folder:
    saved = Path(folder) / "edited.json"
    stream.scenario.save(saved)
    replay = ts.Stream(saved, **settings)
    for index in (11, 4, 7, 0):  # in any order
        assert replay[index].depth.tobytes() == seen[index].depth.tobytes()
        assert replay[index].instance.tobytes() == seen[index].instance.tobytes()
print("The replay has the same bytes.")
