# SPDX-License-Identifier: Apache-2.0
"""`tiscene verify`: check the files of an export or a data set, and render frames again."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiscene.cli.terminal import progress, task_shown
from tiscene.errors import ExportError, counted
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.data_set_verification import verify_data_set
from tiscene.export.manifest import listed_frames
from tiscene.export.verification import evenly, verify

MAX_LISTED = 20


def run(args: argparse.Namespace) -> None:
    """Verify, and print one line. Raises ExportError if anything differs."""
    data_set = DataSet.load(Path(args.folder))
    if data_set is None:
        _verify_export(args)
    else:
        _verify_data_set(args, data_set.count)


def _verify_export(args: argparse.Namespace) -> None:
    count = len(listed_frames(Path(args.folder)))
    with progress(f"verifying {args.folder}", count + len(evenly(range(count), args.sample))) as step:

        def show(index: int, is_rendered: bool) -> None:
            step(task=f"frame {index}" if is_rendered else f"files of frame {index}")

        found = verify(args.folder, sample=args.sample, search=args.search, arch=args.arch, progress=show)
    if not found.is_good:
        raise ExportError(f"{args.folder}: {'; '.join(found.problems())}")
    print(f"files of {counted(found.frames, 'frame')} are complete; {found.rendered:,} rendered again, same bytes")


def _verify_data_set(args: argparse.Namespace, count: int) -> None:
    with progress(f"verifying {args.folder}", count) as step:

        def show(number: int, frame: int | None) -> None:
            step(int(frame is None), task=f"scenario {number}" + ("" if frame is None else f", frame {frame}"))

        found = verify_data_set(
            args.folder,
            sample=args.sample,
            search=args.search,
            arch=args.arch,
            progress=show,
            index_progress=task_shown(step),
        )
    if not found.is_good:
        lines = [f"\n  {place}: {'; '.join(problems)}" for place, problems in found.problems.items()]
        if len(lines) > MAX_LISTED:
            lines[MAX_LISTED:] = [f"\n  and {len(lines) - MAX_LISTED} more"]
        raise ExportError(f"{args.folder}: problems of the data set:{''.join(lines)}")
    failed = f", {found.failed} of them with an error and without frames" if found.failed else ""
    print(
        f"{counted(found.scenarios, 'scenario')}{failed}: files of {counted(found.frames, 'frame')} are complete; "
        f"{found.rendered:,} rendered again, same bytes"
    )
