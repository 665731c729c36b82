# SPDX-License-Identifier: Apache-2.0
"""`tiscene render`: write frames of a scene or scenario into a folder."""

from __future__ import annotations

import argparse
import re
import shutil
import warnings
from pathlib import Path
from typing import Any

from tiscene.cli.terminal import note, progress, total_shown
from tiscene.errors import ArgumentError, StageWarning
from tiscene.export import distributed, manifest
from tiscene.export.distributed.worker_processes import frames_in, run_workers, shard_commands
from tiscene.export.exporter import export, open_manifest, provenance
from tiscene.export.formats import find_format
from tiscene.export.merging import merge
from tiscene.export.shards import SHARDS, Shard, machine
from tiscene.frame.buffers import BUFFERS, buffer_names
from tiscene.frame.frame import Frame
from tiscene.sailenv.captured_scenario import capture_scenario
from tiscene.stream.stream import DEFAULT_BUFFERS, Stream


def run(args: argparse.Namespace) -> None:
    """Render, and print the folder. An interrupted run prints how to continue it."""
    frames = selected_frames(args.frames, args.count)
    form = find_format(args.format)
    named = args.buffers or form.default_buffers or DEFAULT_BUFFERS
    buffers = tuple(BUFFERS) if args.buffers == ("all",) else buffer_names(named)
    form.check(buffers, frames)
    if args.sailenv:
        args.source, (width, height), received = capture_scenario(Path(args.source), frames[-1] + 1, fps=args.fps)
        args.width, args.height = args.width or width, args.height or height
        frames = frames[: sum(index < received for index in frames)]
    settings = stream_settings(args, buffers)
    if args.ray is not None or args.workers > 1:
        if args.ray is not None:
            _render_on_ray(args, frames, settings)
        else:
            _render_with_workers(args, frames)
        print(args.output)
        return
    folder = Path(args.output)
    if args.shard:
        part = Shard(args.shard[0], args.shard[1], (frames.start, frames.stop, frames.step), machine())
        folder, frames = part.folder(args.output), part.own_frames
    try:
        with progress(f"reading {args.source}", len(frames)) as step:
            stream = Stream(
                args.source,
                **settings,
                progress=lambda task, fraction: step(0, task=f"{task}: {fraction:.0%}"),
            )
            if not any(each.instances for each in stream.world.descriptions):
                warnings.warn(StageWarning(f"{args.source}: there is no geometry to render"), stacklevel=2)
            if args.shard and not args.overwrite:  # now, not at the merge
                open_manifest(Path(args.output), provenance(stream, args.format, args.objects), False)
            if args.shard:  # first, so that a merge misses the frames of a killed shard
                part.save(folder)
            step(0, task="first frame")

            def frame_done(index: int, frame: Frame | None) -> None:
                step(task=f"frame {index}")

            export(
                stream,
                folder,
                format=args.format,
                frames=frames,
                objects=args.objects,
                overwrite=args.overwrite,
                pack=not args.shard,
                progress=frame_done,
            )
    except KeyboardInterrupt:
        done = _written_frames(folder, frames)
        note(f"Interrupted: {done} of {len(frames)} frames are in {folder}. The same command continues from there.")
        raise
    print(folder)


def stream_settings(args: argparse.Namespace, buffers: tuple[str, ...]) -> dict[str, Any]:
    """Return the arguments of Stream that the command line gives."""
    return {
        "width": args.width,
        "height": args.height,
        "fps": args.fps,
        "buffers": buffers,
        "quality": args.quality,
        "spp": args.spp,
        "max_depth": args.max_depth,
        "denoise": args.denoise,
        "relative_error": args.relative_error,
        "clamp": args.clamp,
        "pixel_filter": args.pixel_filter,
        "incremental": args.incremental,
        "seed": args.seed,
        "camera": args.camera[0] if args.camera and len(args.camera) == 1 else args.camera,
        "shutter": args.shutter,
        "time_code": args.time_code,
        "variants": dict(args.variant),
        "taxonomy": args.taxonomy,
        "categories": args.categories,
        "root": args.root,
        "untrusted": args.untrusted,
        "strict": args.strict,
        "subdivision": args.subdivision,
        "arch": args.arch,
    }


def _written_frames(folder: Path, frames: range) -> int:
    """Return how many of some frames the manifest of a folder lists, without reading all of its JSON."""
    try:
        text = (folder / manifest.NAME).read_bytes()
    except OSError:
        return 0
    return sum(int(index) in frames for index in re.findall(rb'\n  "(\d+)": {', text))


def _render_with_workers(args: argparse.Namespace, frames: range) -> None:
    """Render shards in processes of their own, and merge them. Interrupted, the shards stay and are continued."""
    shards = [Shard(number, args.workers, (frames.start, frames.stop, frames.step)) for number in range(args.workers)]
    folders = [each.folder(args.output) for each in shards]
    try:
        with progress(f"{args.workers} workers", len(frames)) as step:
            show = total_shown(step)
            commands = shard_commands(args.command_line, args.workers)
            run_workers(commands, lambda: show(frames_in(folders)))
            step(0, task="merging")
            merge(args.output, folders, overwrite=args.overwrite)
    except KeyboardInterrupt:
        note(f"Interrupted: the shards are in {Path(args.output) / SHARDS}. The same command continues from there.")
        raise
    shutil.rmtree(Path(args.output) / SHARDS)


def _render_on_ray(args: argparse.Namespace, frames: range, settings: dict[str, Any]) -> None:
    """Render on a Ray cluster. Interrupted, the shards stay and are continued."""
    try:
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
    except KeyboardInterrupt:
        note(f"Interrupted: the shards are in {Path(args.output) / SHARDS}. The same command continues from there.")
        raise


def selected_frames(frames: slice | None, count: int | None) -> range:
    """Return the frames that `--frames` and `--count` select.

    Args:
        frames: A slice with start, stop (None: no end) and step; None for frame 0, or for all from 0 on with a count.
        count: The maximum number of frames; None: no limit.

    Raises:
        ArgumentError: The count is not positive, or the frames have no end.
    """
    if count is not None and count < 1:
        raise ArgumentError(f"--count {count}: must be at least 1")
    if frames is None:
        return range(count or 1)
    if frames.stop is not None:
        return range(frames.start, frames.stop, frames.step)[:count]
    if count is None:
        start = frames.start
        raise ArgumentError(
            f"--frames {start}: has no end, and neither has a stream: give an end, such as {start}:{start + 100}"
        )
    return range(frames.start, frames.start + count * frames.step, frames.step)
