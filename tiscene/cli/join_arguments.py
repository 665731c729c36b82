# SPDX-License-Identifier: Apache-2.0
"""Command-line arguments of `tiscene join`: rooms with their places, and openings."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from typing import Any

from tiscene.cli.argument_types import path
from tiscene.cli.common_arguments import Commands

_ROOM = "ROOM[@[X,Y,Z][,yaw=DEGREES][,name=NAME]]"
_OPENING = "X,Y,Z[,width=M][,height=M][,depth=M][,yaw=DEGREES][,clearance=M][,lined=no]"
_ROOM_FIELDS: Mapping[str, Callable[[str], Any]] = {"yaw": float, "name": str}
_OPENING_FIELDS: Mapping[str, Callable[[str], Any]] = {
    **dict.fromkeys(("width", "height", "depth", "yaw", "clearance"), float),
    "lined": {"yes": True, "no": False}.__getitem__,
}


def add_join(commands: Commands) -> None:
    """Add the command `join`."""
    join = commands.add_parser(
        "join",
        help="write one stage out of several rooms, with openings between them",
        description="Write a stage that references rooms, placed beside one another, and cut openings into their "
        "walls. The files of the rooms are not changed (see docs/scenes.md). An example: tiscene join "
        "room_04@name=kitchen room_05@-0.96,0,5.4 --opening -0.96,0,2.2,depth=0.4 -o home.usda",
    )
    join.add_argument(
        "rooms",
        metavar="ROOM[@X,Y,Z]",
        type=room,
        nargs="+",
        help=f"a USD file or the name of a scene, and where it stands, m; in full: {_ROOM}",
    )
    join.add_argument(
        "-o", "--output", metavar="FILE", type=path, required=True, help="the stage to write: .usda, .usdc or .usd"
    )
    join.add_argument(
        "--opening",
        metavar="X,Y,Z",
        type=opening,
        action="append",
        default=[],
        help=f"a passage, by the middle of its floor, m; in full: {_OPENING}; may be repeated",
    )
    join.add_argument("--name", metavar="NAME", help="name of the root prim (default: from the file's name)")
    join.add_argument(
        "--sky", metavar="ROOM", help="the room whose dome and distant lights are kept (default: the first with any)"
    )
    join.add_argument("--overwrite", action="store_true", help="replace FILE if it exists")


def room(text: str) -> dict[str, Any]:
    """Return the fields of the RoomPlacement "room_05@-0.96,0,5.4,yaw=90,name=bath"."""
    file, separator, place = text.rpartition("@")
    if not separator:
        return {"file": text}
    fields = _fields(place, _ROOM_FIELDS)
    if not fields:
        raise argparse.ArgumentTypeError(f"{text!r} is not {_ROOM}, such as room_05@-0.96,0,5.4,yaw=90")
    return {"file": file, **fields}


def opening(text: str) -> dict[str, Any]:
    """Return the fields of the Opening "-0.96,0,2.2,depth=0.4,lined=no"."""
    fields = _fields(text, _OPENING_FIELDS)
    if "position" not in fields:
        raise argparse.ArgumentTypeError(f"{text!r} is not {_OPENING}, such as -0.96,0,2.2,depth=0.4")
    return fields


def _fields(text: str, types: Mapping[str, Callable[[str], Any]]) -> dict[str, Any]:
    """Return the fields of "X,Y,Z,KEY=VALUE,...", whose position or keys may be left out; {} if they are wrong."""
    words = text.split(",")
    named = [word.partition("=") for word in words if "=" in word]
    numbers = [word for word in words if "=" not in word]
    try:
        position = {"position": tuple(map(float, numbers))} if numbers else {}
        fields = {key: types[key](value) for key, _, value in named}
    except (KeyError, ValueError):
        return {}
    return {**position, **fields} if len(numbers) in (0, 3) else {}
