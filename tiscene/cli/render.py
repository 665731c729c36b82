# SPDX-License-Identifier: Apache-2.0
"""`tiscene render`: frames of a scene or scenario into a folder."""

from __future__ import annotations

import argparse

from tiscene.cli.terminal import note, progress
from tiscene.export import NEEDED, export
from tiscene.frame.buffers import BUFFERS
from tiscene.frame.frame import Frame
from tiscene.stream.incremental import pays
from tiscene.stream.stream import DEFAULT_BUFFERS, Stream


def run(args: argparse.Namespace) -> None:
    """Render, and print the folder. When interrupted, say how to go on."""
    usual = ("rgb", *NEEDED[args.format]) if args.format in NEEDED else DEFAULT_BUFFERS
    buffers = tuple(BUFFERS) if args.buffers == ("all",) else args.buffers or usual
    done = 0
    try:
        with progress(f"reading {args.source}", len(args.frames)) as step:
            stream = Stream(
                args.source,
                width=args.width,
                height=args.height,
                fps=args.fps,
                buffers=buffers,
                quality=args.quality,
                spp=args.spp,
                max_depth=args.max_depth,
                denoise=args.denoise,
                error=args.error,
                clamp=args.clamp,
                pixel_filter=args.pixel_filter,
                shutter=args.shutter,
                seed=args.seed,
                camera=args.camera[0] if args.camera and len(args.camera) == 1 else args.camera,
                variants=dict(args.variant),
                time_code=args.time_code,
                taxonomy=args.taxonomy,
                root=args.root,
                untrusted=args.untrusted,
                arch=args.arch,
                incremental=_differential(args),
                progress=lambda doing, done: step(0, doing=f"{doing}: {done:.0%}"),
            )
            step(0, doing="first frame")

            def frame_done(index: int, frame: Frame | None) -> None:
                nonlocal done
                done += 1
                step(doing=f"frame {index}")

            export(
                stream,
                args.output,
                format=args.format,
                frames=args.frames,
                objects=args.objects,
                overwrite=args.overwrite,
                progress=frame_done,
            )
    except KeyboardInterrupt:
        total = len(args.frames)
        note(f"Interrupted: {done} of {total} frames are in {args.output}. The same command goes on from there.")
        raise
    print(args.output)


def _differential(args: argparse.Namespace) -> bool | None:
    """What was asked for, else whether it pays for so many frames; the stream knows whether it can be."""
    wanted: bool | None = args.incremental
    return wanted if wanted is not None or pays(len(args.frames)) else False
