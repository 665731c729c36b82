# SPDX-License-Identifier: Apache-2.0
"""`tiscene generate`: render a data set of many random scenarios from a recipe."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiscene.cli.terminal import note, progress, total_shown
from tiscene.export import distributed
from tiscene.export.distributed.worker_processes import run_workers, shard_commands
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.generator import claim, finish, generate
from tiscene.export.generation.recipe import Recipe
from tiscene.export.shards import Shard


def run(args: argparse.Namespace) -> None:
    """Generate, and print the folder. An interrupted run is continued by the same command."""
    recipe = Recipe.load(args.recipe)
    for message in recipe.unknown_names():
        note(f"Scenarios will have an error: {message}")
    try:
        if args.ray is not None:
            _generate_on_ray(args, recipe)
        elif args.workers > 1:
            _generate_with_workers(args, recipe)
        else:
            _generate(args, recipe)
        _note_failures(DataSet(Path(args.output), recipe, args.count))
    except KeyboardInterrupt:
        note(f"Interrupted: the same command continues the data set in {args.output}.")
        raise
    print(args.output)


def _generate(args: argparse.Namespace, recipe: Recipe) -> None:
    """Generate in this process."""
    shard: tuple[int, int] = args.shard or (0, 1)
    with progress("reading the first scene", len(Shard(*shard, (0, args.count, 1)).own_frames)) as step:
        generate(
            recipe,
            args.output,
            args.count,
            shard=shard,
            arch=args.arch,
            progress=lambda scenario, frame: step(int(frame is None), task=f"scenario {scenario}"),
        )


def _generate_with_workers(args: argparse.Namespace, recipe: Recipe) -> None:
    """Generate shards in processes of their own, and write the index."""
    data_set = DataSet(Path(args.output), recipe, args.count)
    claim(data_set)
    with progress(f"{args.workers} workers", args.count) as step:
        show = total_shown(step)
        run_workers(shard_commands(args.command_line, args.workers), lambda: show(data_set.done()))
        step(0, task="index")
        finish(args.output)


def _note_failures(data_set: DataSet) -> None:
    """Tell how many scenarios have an error, and the first one."""
    failed = [(number, each["error"]) for number, each in data_set.summaries() if each is not None and "error" in each]
    if failed:
        number, error = failed[0]
        note(f"{len(failed)} of {data_set.count} scenarios have an error, the first is {number}: {error}")


def _generate_on_ray(args: argparse.Namespace, recipe: Recipe) -> None:
    """Generate on a Ray cluster."""
    with progress("connecting to Ray", args.count) as step:
        show = total_shown(step)
        distributed.generate(
            recipe,
            args.output,
            args.count,
            arch=args.arch,
            address=args.ray or None,
            cpus=args.worker_cpus,
            unlike=args.unlike,
            progress=lambda count: show(count, "scenarios"),
        )
