# SPDX-License-Identifier: Apache-2.0
"""Command-line arguments of `verify`, `merge`, `sample` and `generate`, and those of `render` for shards."""

from __future__ import annotations

import argparse

from tiscene.cli.argument_types import count, path
from tiscene.cli.common_arguments import Commands, add_arch, add_output


def add_parts(command: argparse.ArgumentParser, place: str) -> None:
    """Add the arguments by which several processes write one export or data set.

    Args:
        command: The command.
        place: The folder that a shard writes.
    """
    parts = command.add_mutually_exclusive_group()
    parts.add_argument(
        "--shard",
        metavar="I/N",
        type=shard,
        help=f"render part I of N (0/8 to 7/8) into {place}, for `tiscene merge DIR`; on any machine, in any order",
    )
    parts.add_argument(
        "--workers", metavar="N", type=count, default=1, help="processes on this machine (default: %(default)s)"
    )
    parts.add_argument(
        "--ray",
        metavar="ADDRESS",
        nargs="?",
        const="",
        type=ray_address,
        help="render on the nodes of a Ray cluster, HOST:PORT; without ADDRESS that in RAY_ADDRESS, else the one on "
        "this machine, else a new one of this machine; DIR must be on a file system that all nodes share",
    )
    command.add_argument(
        "--worker-cpus", metavar="N", type=int, help="processors of each worker of --ray (default: all of its node)"
    )
    command.add_argument("--unlike", action="store_true", help="let nodes of --ray be unlike machines")


def add_verify(commands: Commands) -> None:
    """Add the command `verify`."""
    verify = commands.add_parser(
        "verify",
        help="check the files of an export or data set, and render its frames again",
        description="Compare the files of an export, or of all scenarios of a data set, with their manifests, render "
        "frames again and compare their buffers. The scene is found by its digest, also where its path is another. "
        "Exit status 2 if anything differs.",
    )
    verify.add_argument("folder", metavar="DIR", type=path, help="the folder of the export or data set")
    verify.add_argument(
        "--sample",
        metavar="N",
        type=int,
        help="frames to render again, of all scenarios together; 0: files alone are checked (default: all)",
    )
    verify.add_argument(
        "--search",
        metavar="DIR",
        type=path,
        action="append",
        default=[],
        help="folder with files of the scene; may be repeated",
    )
    add_arch(verify)


def add_merge(commands: Commands) -> None:
    """Add the command `merge`."""
    merge = commands.add_parser(
        "merge",
        help="make one export of the shards of render --shard",
        description="Merge shards into one export, with the files and the manifest of an export in one go. The shards "
        "stay as they are; merging again is safe. In a data set, write the index. Exit status 3 if its scenarios "
        "have errors.",
    )
    merge.add_argument("folder", metavar="DIR", type=path, help="the folder to write")
    merge.add_argument(
        "parts", metavar="PART", type=path, nargs="*", help="folders of shards (default: all in DIR/shards)"
    )
    merge.add_argument("--partial", action="store_true", help="merge although frames are missing")
    merge.add_argument("--unlike", action="store_true", help="merge shards of unlike machines")
    merge.add_argument("--overwrite", action="store_true", help="replace frames that were made with other settings")


def add_sample(commands: Commands) -> None:
    """Add the command `sample`."""
    sample = commands.add_parser(
        "sample",
        help="write random scenarios of a recipe as files",
        description="Draw scenarios from a recipe (see docs/data-sets.md) and write them as JSON, without rendering. "
        "Exit status 3 if some of them cannot be drawn.",
    )
    _add_recipe(sample)


def add_generate(commands: Commands) -> None:
    """Add the command `generate`."""
    generate = commands.add_parser(
        "generate",
        help="render a data set of many random scenarios from a recipe",
        description="Draw scenarios from a recipe (see docs/data-sets.md) and render each into a folder of its own, "
        "with an index, statistics and a contact sheet. The same command continues after an interruption. Exit status "
        "3 if scenarios have errors; the others are made all the same.",
    )
    _add_recipe(generate)
    add_parts(generate, "the same DIR")
    add_arch(generate)


def _add_recipe(command: argparse.ArgumentParser) -> None:
    """Add the recipe, the number of its scenarios, and the folder."""
    command.add_argument(
        "recipe", metavar="RECIPE", type=path, help="a JSON file: scenes, ranges, frames, settings, splits"
    )
    command.add_argument("-n", "--count", metavar="N", type=count, required=True, help="number of scenarios")
    add_output(command)


def ray_address(text: str) -> str:
    """Return the address of a Ray cluster."""
    if text in ("", "auto", "local") or ":" in text:
        return text
    raise argparse.ArgumentTypeError(f"{text!r} is not an address, such as 10.0.0.5:6379; --ray alone goes last")


def shard(text: str) -> tuple[int, int]:
    """Return the numbers of "I/N"."""
    first, _, second = text.partition("/")
    if not (first.isdecimal() and second.isdecimal() and int(first) < int(second)):
        raise argparse.ArgumentTypeError(f"{text!r} is not I/N with 0 <= I < N, such as 0/8")
    return int(first), int(second)
