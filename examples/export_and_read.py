# SPDX-License-Identifier: Apache-2.0
"""Write a small data set, continue it, and read it back with NumPy and Pillow.

python examples/export_and_read.py dataset
"""

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image

import tiscene as ts
from tiscene.export import export

arguments = argparse.ArgumentParser(description="Write a data set and read it.")
arguments.add_argument("folder", type=Path)
arguments.add_argument("--frames", type=int, default=10)
arguments.add_argument("--width", type=int, default=128)
args = arguments.parse_args()

scenario = ts.Scenario.sample("solid_benchmark", seed=3, objects=2)
stream = ts.Stream(scenario, width=args.width, height=args.width * 3 // 4, buffers=("instance", "depth"))
export(stream, args.folder, format="png", frames=range(args.frames // 2), objects="visible")
export(stream, args.folder, format="png", frames=range(args.frames), objects="visible")  # renders the other half only

for labels in sorted(args.folder.glob("labels/*.json")):
    content = json.loads(labels.read_text())
    with Image.open(args.folder / "instance" / f"{labels.stem}.png") as image:
        instance = np.asarray(image)
    with Image.open(args.folder / "depth" / f"{labels.stem}.png") as image:
        depth = np.asarray(image) / 1000  # mm to m
    assert np.array_equal(instance, stream[content["index"]].instance)
    for row in content["objects"]:
        x0, y0, x1, y1 = map(int, row["visible_box"])
        nearest = depth[y0:y1, x0:x1][instance[y0:y1, x0:x1] == row["id"]].min()
        print(
            f"frame {content['index']}: {row['name']} ({row['category']}) {row['visible_pixels']} px, {nearest:.2f} m"
        )
