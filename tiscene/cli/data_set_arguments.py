# SPDX-License-Identifier: Apache-2.0
"""Command-line arguments of the commands that write and check data sets in parts: of `verify` and `merge`, and some of
`render`.
"""

from __future__ import annotations

import argparse
from typing import Any


def add_parts(command: argparse.ArgumentParser) -> None:
    """Add the arguments by which several processes write one export."""
    command.add_argument(
        "--shard",
        metavar="I/N",
        type=shard,
        help="render part I of N (0/8 to 7/8) into DIR/shards, for `tiscene merge DIR`; on any machine, in any order",
    )
    command.add_argument(
        "--workers", metavar="N", type=int, default=1, help="processes on this machine (default: %(default)s)"
    )


def add_verify(commands: Any) -> None:
    """Add the command `verify`."""
    verify = commands.add_parser(
        "verify",
        help="check the files of an export, and render its frames again",
        description="Compare the files of an export with its manifest, render frames again and compare their buffers. "
        "The scene is found by its digest, also where its path is another. Exit status 2 if anything differs.",
    )
    verify.add_argument("folder", metavar="DIR", help="the folder of the export")
    verify.add_argument(
        "--sample", metavar="N", type=int, help="frames to render again; 0: files alone are checked (default: all)"
    )
    verify.add_argument(
        "--search", metavar="DIR", action="append", default=[], help="folder with files of the scene; may be repeated"
    )
    verify.add_argument("--arch", metavar="NAME", help="cpu or cuda (default: cpu)")


def add_merge(commands: Any) -> None:
    """Add the command `merge`."""
    merge = commands.add_parser(
        "merge",
        help="make one export of the shards of render --shard",
        description="Merge shards into one export, with the files and the manifest of an export in one go. The shards "
        "stay as they are; merging again is safe.",
    )
    merge.add_argument("folder", metavar="DIR", help="the folder to write")
    merge.add_argument("parts", metavar="PART", nargs="*", help="folders of shards (default: all in DIR/shards)")
    merge.add_argument("--partial", action="store_true", help="merge although frames are missing")
    merge.add_argument("--unlike", action="store_true", help="merge shards of unlike machines")


def shard(text: str) -> tuple[int, int]:
    """Return the numbers of "I/N"."""
    first, _, second = text.partition("/")
    if not (first.isdecimal() and second.isdecimal() and int(first) < int(second)):
        raise argparse.ArgumentTypeError(f"{text!r} is not I/N with 0 <= I < N, such as 0/8")
    return int(first), int(second)
