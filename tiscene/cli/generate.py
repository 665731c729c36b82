# SPDX-License-Identifier: Apache-2.0
"""`tiscene generate`: render a data set of many random scenarios from a recipe."""

from __future__ import annotations

import argparse

from tiscene.cli.terminal import note, progress
from tiscene.export.generation.generator import generate
from tiscene.export.generation.recipe import Recipe


def run(args: argparse.Namespace) -> None:
    """Generate, and print the folder. An interrupted run is continued by the same command."""
    recipe = Recipe.load(args.recipe)
    number, of = args.shard or (0, 1)
    count = args.count * (number + 1) // of - args.count * number // of
    try:
        with progress("reading the first scene", count) as step:
            generate(
                recipe,
                args.output,
                args.count,
                shard=(number, of),
                arch=args.arch,
                progress=lambda scenario, frame: step(int(frame is None), task=f"scenario {scenario}"),
            )
    except KeyboardInterrupt:
        note(f"Interrupted: the same command continues the data set in {args.output}.")
        raise
    print(args.output)
