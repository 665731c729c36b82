# SPDX-License-Identifier: Apache-2.0
"""A stream in a loop: objects that move through a room, with labels, and any frame again by its index.

python examples/loop.py --frames 25
"""

import argparse

import numpy as np

import tiscene as ts

arguments = argparse.ArgumentParser(description="Print what moves in a room.")
arguments.add_argument("--frames", type=int, default=25)
arguments.add_argument("--width", type=int, default=256)
args = arguments.parse_args()

loop = [
    ts.Waypoint((-1.2, 1.0, -2.1)),
    ts.Waypoint((0, 1.4, -2.2), (0, 90, 0)),
    ts.Waypoint((-0.6, 0.9, -3), (0, 180, 0)),
]
scenario = ts.Scenario(
    "room_02",
    [
        ts.Object("chair", "Chair 01", dynamic=ts.CatmullWaypoints(loop, total_time=6.0)),
        ts.Object(
            "ball",
            "Ball 01",
            (-0.7, 1.4, -1.2),
            dynamic=ts.UniformMovementRandomBounce(speed=1.5, start_direction=(0, -1, 0), seed=4),
        ),
    ],
)
buffers = ("instance", "depth", "forward_flow")
with ts.Stream(scenario, width=args.width, height=args.width * 3 // 4, frames=args.frames, buffers=buffers) as stream:
    for frame in stream:
        for row in frame.objects:
            if row.template and row.visible_pixels:
                mask = frame.instance == row.id
                flow = np.linalg.norm(frame.forward_flow[mask], axis=1).mean()
                nearest = frame.depth[mask].min()
                print(f"{frame.time:5.2f} s  {row.name:6} {nearest:5.2f} m away, moves {flow:5.2f} px a frame")
        for event in frame.events:
            print(f"{frame.time:5.2f} s  {event.kind}: object {event.object} {event.surface}")
    again = stream[args.frames // 2]
    assert np.array_equal(again.depth, stream[args.frames // 2].depth)
