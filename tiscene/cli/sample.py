# SPDX-License-Identifier: Apache-2.0
"""`tiscene sample`: write random scenarios of a recipe as files."""

from __future__ import annotations

import argparse

from tiscene.cli.terminal import note, progress
from tiscene.errors import TisceneError, counted
from tiscene.export.distributed.worker_processes import INCOMPLETE
from tiscene.export.generation.generator import OF_SCENARIO, write_scenario
from tiscene.export.generation.recipe import Recipe


def run(args: argparse.Namespace) -> int:
    """Draw the scenarios, and print their files. One that cannot be drawn does not keep others from being written.

    Returns:
        The exit status.
    """
    recipe = Recipe.load(args.recipe)
    failed: list[tuple[int, TisceneError]] = []
    with progress("drawing scenarios", args.count) as step:
        for number in range(args.count):
            try:
                print(write_scenario(recipe, args.output, number))
            except OF_SCENARIO as mistake:
                failed.append((number, mistake))
            step()
    if not failed:
        return 0
    number, error = failed[0]
    if len(failed) == args.count:
        raise error
    note(f"{len(failed)} of {counted(args.count, 'scenario')} cannot be drawn, the first is {number}: {error}")
    return INCOMPLETE
