# SPDX-License-Identifier: Apache-2.0
"""`tiscene sample`: write random scenarios of a recipe as files."""

from __future__ import annotations

import argparse

from tiscene.cli.terminal import progress
from tiscene.export.generation.generator import write_scenarios
from tiscene.export.generation.recipe import Recipe


def run(args: argparse.Namespace) -> None:
    """Draw the scenarios, and print their files."""
    recipe = Recipe.load(args.recipe)
    with progress("drawing scenarios", args.count) as step:
        for number in range(args.count):
            for file in write_scenarios(recipe, args.output, args.count, [number]):
                print(file)
            step()
