# SPDX-License-Identifier: Apache-2.0
"""`tiscene demo`: render a short scenario with every buffer, as a contact sheet and an animation."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynamics import AllTogether, CatmullWaypoints, Waypoint
from tiscene.cli.terminal import note, progress, task_shown
from tiscene.errors import ArgumentError, export_errors
from tiscene.export.animated_image import write_animation
from tiscene.export.contact_sheet import contact_sheet
from tiscene.export.png import write_png
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.frame import Frame
from tiscene.frame.visualize import Limits, limits_of
from tiscene.scenario.objects import Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.stream.stream import Stream

SCENE = "room_02"
FPS = 8.0
SECONDS = 3.0  # the period of all trajectories
ANIMATED = ("rgb", "instance", "depth", "forward_flow")


def scenario() -> Scenario:
    """Return a scenario of four objects on closed curves through the free space of the living room."""

    def loop(*poses: tuple[tuple[float, float, float], tuple[float, float, float]]) -> CatmullWaypoints:
        return CatmullWaypoints([Waypoint(position, rotation) for position, rotation in poses], total_time=SECONDS)

    chair = loop(
        ((-1.22, 1.0, -2.09), (0, 0, 0)), ((-0.06, 1.35, -2.22), (25, 120, 0)), ((-0.41, 0.8, -1.6), (0, 240, 15))
    )
    racket = loop(
        ((0.3, 1.5, -1.51), (0, 0, 40)), ((-0.1, 1.75, -1.42), (60, 90, 0)), ((0.39, 1.8, -2.0), (0, 180, 80))
    )
    ball = loop(((-1.21, 0.5, -0.97), (0, 0, 0)), ((-1.75, 1.6, -1.59), (90, 0, 0)), ((-1.22, 1.9, -2.75), (180, 0, 0)))
    pillow = loop(
        ((-0.42, 1.5, -3.38), (20, 0, 0)), ((0.21, 1.1, -3.03), (90, 60, 0)), ((-0.15, 1.8, -3.96), (150, 120, 40))
    )
    return Scenario(
        SCENE,
        [
            Object("chair", "Chair 01", dynamic=chair, collide=False),
            Object("racket", "Tennis Racket 01", dynamic=racket, collide=False),
            Object("ball", "Ball 01", dynamic=ball, collide=False),
            Object("pillow", "Pillow 01", dynamic=pillow, collide=False),
        ],
        timings=AllTogether(0.0),
        camera=Camera.look_at(
            (0.75, 1.32, 0.72), (-1.72, 0.88, -4.2), vertical_fov=math.radians(46.0), exposure=2.5, name="Demo"
        ),
    )


def run(args: argparse.Namespace) -> None:
    """Render the scenario, write the images, and print their paths."""
    if args.frames < 1:
        raise ArgumentError(f"--frames {args.frames}: must be at least 1")
    folder = Path(args.output or "tiscene-demo")
    demo = scenario()
    with progress(f"reading {demo.scene}", args.frames) as step:
        stream = Stream(
            demo,
            width=args.width,
            height=args.height,
            fps=FPS,
            frames=args.frames,
            buffers=tuple(BUFFERS),
            quality=args.quality,
            arch=args.arch,
            progress=task_shown(step),
        )
        with export_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        demo.save(folder / "scenario.json")
        step(0, task="compiling kernels, in the first run only")
        frames, middle = [], args.frames // 2
        for index in range(args.frames):
            frame = stream[index]
            if index == 0:
                write_png(folder / "first_frame.png", frame.rgb)
                note(f"First frame: {folder / 'first_frame.png'}")
            if index == middle:
                write_png(folder / "contact_sheet.png", contact_sheet(frame))
            frames.append(replace(frame, buffers={name: frame.buffers[name] for name in ANIMATED}))
            step(task="rendering")
    write_animation(folder / "animation.webp", animated(frames), FPS)
    print(f"All buffers of frame {middle}: {folder / 'contact_sheet.png'}")
    print(f"Animation:               {folder / 'animation.webp'}")
    print(f"To render the scenario:  tiscene render {folder / 'scenario.json'} --frames 0:100 -o frames")


def animated(frames: list[Frame]) -> list[NDArray[np.uint8]]:
    """Return a sheet of four buffers for each frame, with the same color scales in all frames."""
    limits: dict[str, Limits] = {name: limits_of(name, [frame.buffers[name] for frame in frames]) for name in ANIMATED}
    return [contact_sheet(frame, ANIMATED, columns=2, limits=limits) for frame in frames]
