# SPDX-License-Identifier: Apache-2.0
"""Command-line arguments of `tiscene render`."""

from __future__ import annotations

import argparse

from tiscene.cli.argument_types import frame_slice, name_list, number_list
from tiscene.cli.common_arguments import (
    Commands,
    add_arch,
    add_fps,
    add_output,
    add_quality,
    add_reading,
    add_seed,
    add_size,
    add_source,
    add_spp,
)
from tiscene.cli.data_set_arguments import add_parts
from tiscene.export.formats import FORMATS


def add_render(commands: Commands) -> None:
    """Add the command `render`."""
    render = commands.add_parser(
        "render",
        help="write frames of a scene or scenario into a folder",
        description="Write frames into a folder, with a manifest (tiscene.json). The same command continues after an "
        "interruption: frames whose files are there are not rendered again. One command at a time may write into a "
        "folder.",
    )
    add_source(render)
    render.add_argument(
        "--sailenv",
        action="store_true",
        help="the source is a script for SAILenv (.py), which is run once without rendering, or its scenario (.json)",
    )
    add_output(render)
    _add_contents(render)
    add_parts(render, "DIR/shards")
    render.add_argument("--overwrite", action="store_true", help="replace frames that were made with other settings")
    add_size(render, width=None, height=None)
    add_fps(render)
    _add_settings(render)
    render.add_argument(
        "--camera",
        metavar="NAME,...",
        type=name_list,
        help="names or prim paths of cameras of the scene (default: its first); each of several writes into its own "
        "folder",
    )
    render.add_argument(
        "--time-code", metavar="T", type=float, help="show the stage at this time code, static (default: it plays)"
    )
    render.add_argument(
        "--categories",
        metavar="NAME,...",
        type=name_list,
        help="categories with the ids 1, 2, ... in semantic; everything else is 0 (default: all, with the ids that "
        "`tiscene list --json` prints)",
    )
    add_reading(render)
    add_arch(render)


def _add_contents(render: argparse.ArgumentParser) -> None:
    """Add the arguments that decide what is written."""
    render.add_argument(
        "--frames",
        metavar="A:B[:STEP]",
        type=frame_slice,
        help="frames as a Python slice: 3:10 is 3 to 9, :10 is 0 to 9, 0:10:2 is every second one; 5: is from 5 on and "
        "needs --count; 7 is frame 7 alone (default: 0; with --count 0:)",
    )
    render.add_argument(
        "--count", metavar="N", type=int, help="at most N of these frames: --frames 5: --count 10 is 5:15"
    )
    render.add_argument(
        "--buffers",
        metavar="NAME,...",
        type=name_list,
        help="buffers to write, or 'all' (default: those that the format requires, else "
        "rgb,semantic,instance,depth,forward_flow)",
    )
    render.add_argument("--format", metavar="NAME", default="png", help=f"{', '.join(FORMATS)} (default: %(default)s)")
    render.add_argument(
        "--objects",
        choices=("moving", "visible", "all"),
        help="write the table of the moving, visible or all objects of each frame (default: no table)",
    )


def _add_settings(render: argparse.ArgumentParser) -> None:
    """Add the arguments that decide how colors are rendered."""
    add_quality(render, "standard")
    add_spp(render)
    render.add_argument(
        "--max-depth", metavar="N", type=int, help="maximum path depth in segments (default: by --quality)"
    )
    render.add_argument("--denoise", action=argparse.BooleanOptionalAction, help="denoise rgb (default: yes)")
    render.add_argument(
        "--relative-error",
        metavar="FRACTION",
        type=float,
        help="sample each pixel until its estimated standard error is this fraction of its luminance, such as 0.02 "
        "(at most --spp samples)",
    )
    render.add_argument(
        "--clamp",
        metavar="MAX",
        type=float,
        help="maximum radiance of a sample, W/m²/sr: removes fireflies and some light (default: none)",
    )
    render.add_argument(
        "--pixel-filter",
        metavar="NAME",
        help="box, triangle, gaussian, mitchell or blackman-harris (default: box)",
    )
    render.add_argument(
        "--shutter",
        metavar="OPEN,CLOSE",
        type=number_list,
        help="motion blur of color: when the shutter opens and closes, in frames from each frame, such as 0,0.5 "
        "(default: the camera's)",
    )
    add_seed(render)
    render.add_argument(
        "--incremental",
        action=argparse.BooleanOptionalAction,
        help="reuse light between frames: a base image where the camera stands, with fast and preview "
        "also panoramas where it turns or walks (default: by --quality)",
    )
