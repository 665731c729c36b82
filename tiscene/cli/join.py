# SPDX-License-Identifier: Apache-2.0
"""`tiscene join`: write one stage out of several rooms, with openings between them."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiscene.cli.terminal import progress, task_shown
from tiscene.errors import ArgumentError
from tiscene.usd import Opening, RoomPlacement, join


def run(args: argparse.Namespace) -> None:
    """Join rooms, and print the path of the stage."""
    rooms = [RoomPlacement(**fields) for fields in args.rooms]
    openings = [Opening(**fields) for fields in args.opening]
    if Path(args.output).exists() and not args.overwrite:
        raise ArgumentError(f"{args.output} exists already: write another file, or --overwrite it")
    with progress(f"joining into {args.output}", 0) as step:
        shown = task_shown(step)
        path = join(rooms, args.output, openings=openings, name=args.name, sky=args.sky, progress=shown)
    print(path)
