# SPDX-License-Identifier: Apache-2.0
"""`tiscene generate`: render a data set of many random scenarios from a recipe."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path

from tiscene.cli.terminal import note, progress, task_shown, total_shown
from tiscene.errors import counted
from tiscene.export import distributed
from tiscene.export.distributed.worker_processes import INCOMPLETE, run_workers, shard_commands
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.generator import claim, finish, generate
from tiscene.export.generation.recipe import Recipe
from tiscene.export.generation.scenario_summary import read_summary
from tiscene.export.shards import Shard


def run(args: argparse.Namespace) -> int:
    """Generate, and print the folder. An interrupted run is continued by the same command.

    Returns:
        The exit status.
    """
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
    except KeyboardInterrupt:
        note(f"Interrupted: the same command continues the data set in {args.output}.")
        raise
    print(args.output)
    return status_of(DataSet(Path(args.output), recipe, args.count), _shard(args).own_frames)


def status_of(data_set: DataSet, numbers: Iterable[int]) -> int:
    """Return the exit status of a command that has made scenarios, and tell how many have an error, and the first one.

    Args:
        data_set: The data set.
        numbers: The scenarios.
    """
    total, failed = 0, []
    for number in numbers:
        summary = read_summary(data_set.scenario_folder(number))
        total += 1
        if summary is not None and "error" in summary:
            failed.append((number, summary["error"]))
    if not failed:
        return 0
    number, error = failed[0]
    note(f"Errors in {len(failed)} of {counted(total, 'scenario')}, the first in {number}: {error}")
    return INCOMPLETE


def _shard(args: argparse.Namespace) -> Shard:
    """Return the part of the scenarios that this command makes."""
    number, count = args.shard or (0, 1)
    return Shard(number, count, (0, args.count, 1))


def _generate(args: argparse.Namespace, recipe: Recipe) -> None:
    """Generate in this process."""
    shard = _shard(args)
    with progress("reading the first scene", len(shard.own_frames)) as step:
        generate(
            recipe,
            args.output,
            args.count,
            shard=(shard.number, shard.count),
            arch=args.arch,
            progress=lambda scenario, frame: step(int(frame is None), task=f"scenario {scenario}"),
            index_progress=task_shown(step),
        )


def _generate_with_workers(args: argparse.Namespace, recipe: Recipe) -> None:
    """Generate shards in processes of their own, and write the index."""
    data_set = DataSet(Path(args.output), recipe, args.count)
    claim(data_set)
    with progress(f"{args.workers} workers", args.count) as step:
        show = total_shown(step)
        run_workers(shard_commands(args.command_line, args.workers), lambda: show(data_set.done()))
        finish(args.output, progress=task_shown(step))


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
            index_progress=task_shown(step),
        )
