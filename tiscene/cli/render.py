# SPDX-License-Identifier: Apache-2.0
"""`tiscene render`: write frames of a scene or scenario into a folder."""

from __future__ import annotations

import argparse
import shutil
import warnings
from pathlib import Path
from typing import Any

from tiscene.cli.stream_arguments import named_buffers, selected_frames, stream_settings
from tiscene.cli.terminal import note, progress, task_shown, total_shown
from tiscene.errors import StageWarning, counted
from tiscene.export import distributed
from tiscene.export.distributed.worker_processes import run_workers, shard_commands
from tiscene.export.exporter import export, matching_manifest, provenance
from tiscene.export.formats import find_format
from tiscene.export.manifest import listed_frames
from tiscene.export.merging import merge
from tiscene.export.shards import SHARDS, Shard, machine
from tiscene.sailenv.captured_scenario import capture_scenario
from tiscene.stream.stream import DEFAULT_BUFFERS, Stream

# Arguments of Stream that other commands do not have as options.
FURTHER_SETTINGS = (
    *("max_depth", "denoise", "relative_error", "clamp", "pixel_filter", "incremental", "shutter", "time_code"),
    "categories",
)


def run(args: argparse.Namespace) -> None:
    """Render, and print the folder. An interrupted run prints how to continue it."""
    frames = selected_frames(args.frames, args.count)
    form = find_format(args.format)
    buffers = named_buffers(args.buffers, form.default_buffers or DEFAULT_BUFFERS)
    form.check(buffers, frames)
    if args.sailenv:
        args.source, (width, height), received = capture_scenario(Path(args.source), frames[-1] + 1, fps=args.fps)
        args.width, args.height = args.width or width, args.height or height
        frames = frames[: sum(index < received for index in frames)]
    settings = stream_settings(args, buffers) | {name: getattr(args, name) for name in FURTHER_SETTINGS}
    folder = Path(args.output)
    if args.ray is not None or args.workers > 1:
        _render_in_shards(args, frames, settings)
    else:
        folder = _render(args, frames, settings)
    print(folder)


def _render(args: argparse.Namespace, frames: range, settings: dict[str, Any]) -> Path:
    """Render all frames, or one shard of them, in this process. Returns the folder."""
    folder = Path(args.output)
    if args.shard:
        part = Shard(args.shard[0], args.shard[1], (frames.start, frames.stop, frames.step), machine())
        folder, frames = part.folder(args.output), part.own_frames
    try:
        with progress(f"reading {args.source}", len(frames)) as step:
            stream = Stream(args.source, **settings, progress=task_shown(step))
            if not any(each.instances for each in stream.world.descriptions):
                warnings.warn(StageWarning(f"{args.source}: there is no geometry to render"), stacklevel=2)
            if args.shard:
                if not args.overwrite:  # now, not at the merge
                    matching_manifest(Path(args.output), provenance(stream, args.format, args.objects))
                part.save(folder)  # first, so that a merge misses the frames of a killed shard
            step(0, task="first frame")
            export(
                stream,
                folder,
                format=args.format,
                frames=frames,
                objects=args.objects,
                overwrite=args.overwrite,
                pack=not args.shard,
                progress=lambda index, _: step(task=f"frame {index}"),
            )
    except KeyboardInterrupt:
        done = len(set(frames).intersection(listed_frames(folder)))
        note(
            f"Interrupted: {done} of {counted(len(frames), 'frame')} in {folder}. "
            "The same command continues from there."
        )
        raise
    return folder


def _render_in_shards(args: argparse.Namespace, frames: range, settings: dict[str, Any]) -> None:
    """Render on a Ray cluster or in several processes. Interrupted, the shards stay and are continued."""
    try:
        if args.ray is not None:
            _render_on_ray(args, frames, settings)
        else:
            _render_with_workers(args, frames)
    except KeyboardInterrupt:
        note(f"Interrupted: the shards are in {Path(args.output) / SHARDS}. The same command continues from there.")
        raise


def _render_with_workers(args: argparse.Namespace, frames: range) -> None:
    """Render shards in processes of their own, and merge them."""
    shards = [Shard(number, args.workers, (frames.start, frames.stop, frames.step)) for number in range(args.workers)]
    folders = [each.folder(args.output) for each in shards]
    with progress(f"{args.workers} workers", len(frames)) as step:
        show = total_shown(step)
        commands = shard_commands(args.command_line, args.workers)
        run_workers(commands, lambda: show(len(listed_frames(*folders))))
        step(0, task="merging")
        merge(args.output, folders, overwrite=args.overwrite)
    shutil.rmtree(Path(args.output) / SHARDS)


def _render_on_ray(args: argparse.Namespace, frames: range, settings: dict[str, Any]) -> None:
    """Render on a Ray cluster."""
    with progress("connecting to Ray", len(frames)) as step:
        show = total_shown(step)
        distributed.render(
            args.source,
            args.output,
            frames=frames,
            format=args.format,
            objects=args.objects,
            overwrite=args.overwrite,
            address=args.ray or None,
            cpus=args.worker_cpus,
            unlike=args.unlike,
            progress=lambda count: show(count, "frames"),
            **settings,
        )
