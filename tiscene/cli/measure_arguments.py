# SPDX-License-Identifier: Apache-2.0
"""Arguments of `tiscene measure`."""

from __future__ import annotations

import argparse
from typing import TypeAlias

from tiscene.cli.argument_types import frame_slice

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def add_measure(commands: Commands) -> None:
    """Add the command."""
    measure = commands.add_parser(
        "measure",
        help="measure how hard the frames of a scene or scenario are",
        description="Print measures of difficulty (visible instances, size, motion, novelty of views and others), and "
        "write them for each frame, with a plot, into a folder. See docs/difficulty.md.",
    )
    measure.add_argument(
        "source", metavar="SCENE_OR_SCENARIO", help="the name of a scene, a USD file, or a scenario (.json)"
    )
    measure.add_argument(
        "-o", "--output", metavar="DIR", help="folder to write (default: tiscene-measure-NAME of the source)"
    )
    measure.add_argument(
        "--frames",
        metavar="A:B[:STEP]",
        type=frame_slice,
        default=slice(0, 250, 5),
        help="frames as a Python slice (default: 0:250:5)",
    )
    measure.add_argument("--width", metavar="PX", type=int, default=128, help="image width (default: %(default)s)")
    measure.add_argument("--height", metavar="PX", type=int, default=96, help="image height (default: %(default)s)")
    measure.add_argument(
        "--fps", metavar="N", type=float, default=25.0, help="frame k shows time k / fps (default: %(default)g)"
    )
    measure.add_argument("--contrast", action="store_true", help="render color too, to measure contrast; slower")
    measure.add_argument(
        "--quality", metavar="NAME", default="fast", help="preset of colors for --contrast (default: %(default)s)"
    )
    measure.add_argument("--arch", metavar="NAME", help="cpu or cuda (default: cpu)")
