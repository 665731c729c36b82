# SPDX-License-Identifier: Apache-2.0
"""Command-line arguments that several commands have."""

from __future__ import annotations

import argparse
from typing import TypeAlias

from tiscene.cli.argument_types import frame_slice, name_list, path, variant_choice

Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"


def add_shown_stream(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `stream_arguments.stream_of`."""
    add_source(command)
    command.add_argument(
        "--frames", metavar="A:B[:STEP]", type=frame_slice, help="frames as a Python slice (default: 0:100)"
    )
    command.add_argument(
        "--buffers",
        metavar="NAME,...",
        type=name_list,
        help="buffers to show, or 'all' (default: rgb,semantic,instance,depth,forward_flow,normal)",
    )
    add_size(command, width=None, height=None)
    add_fps(command)
    add_quality(command, "fast")
    add_spp(command)
    add_seed(command)
    command.add_argument(
        "--camera", metavar="NAME,...", type=name_list, help="names or prim paths of cameras (default: the first)"
    )
    add_reading(command)
    add_arch(command)


def add_source(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "source", metavar="SCENE_OR_SCENARIO", help="the name of a scene, a USD file, or a scenario (.json)"
    )


def add_output(command: argparse.ArgumentParser, default: str = "") -> None:
    """Add the folder to write, which is required unless `default` says in words which one is written otherwise."""
    text = f"folder to write (default: {default})" if default else "folder to write"
    command.add_argument("-o", "--output", metavar="DIR", type=path, required=not default, help=text)


def add_fps(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--fps", metavar="N", type=float, default=25.0, help="frame k shows time k / fps (default: %(default)g)"
    )


def add_size(command: argparse.ArgumentParser, width: int | None, height: int | None) -> None:
    """Add the size of images. None: that of the stage's RenderSettings, else 256 x 192."""
    for name, default, usual in (("width", width, 256), ("height", height, 192)):
        text = "%(default)s" if default else f"of the stage's RenderSettings, else {usual}"
        command.add_argument(
            f"--{name}", metavar="PX", type=int, default=default, help=f"image {name} (default: {text})"
        )


def add_quality(command: argparse.ArgumentParser, default: str) -> None:
    command.add_argument(
        "--quality",
        metavar="NAME",
        default=default,
        help="preset: fast, preview, standard or photo (default: %(default)s)",
    )


def add_spp(command: argparse.ArgumentParser) -> None:
    command.add_argument("--spp", metavar="N", type=int, help="samples per pixel (default: by --quality)")


def add_seed(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--seed", metavar="N", type=int, default=0, help="seed of the rendering (default: %(default)s)"
    )


def add_arch(command: argparse.ArgumentParser) -> None:
    command.add_argument("--arch", metavar="NAME", help="cpu or cuda (default: TISCENE_ARCH, else cpu)")


def add_variant(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--variant",
        metavar="PRIM{SET}=NAME",
        type=variant_choice,
        action="append",
        default=[],
        help="select a variant of the stage, such as '/Room02{lighting}=evening'; may be repeated",
    )


def add_reading(command: argparse.ArgumentParser) -> None:
    """Add the arguments that decide how a stage is read."""
    add_variant(command)
    command.add_argument(
        "--taxonomy", metavar="NAME", help="taxonomy of semantic labels (default: class, else category)"
    )
    command.add_argument("--root", metavar="DIR", type=path, help="refuse layers and textures outside this folder")
    command.add_argument("--strict", action="store_true", help="refuse a stage with a broken part or a missing file")
    command.add_argument(
        "--subdivision",
        metavar="TRIANGLES",
        type=int,
        help="triangles that all subdivision surfaces are refined to at most (default: 3000000; 0: not refined)",
    )
    command.add_argument("--untrusted", action="store_true", help="read the stage in a separate process with limits")
