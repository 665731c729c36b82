# SPDX-License-Identifier: Apache-2.0
"""`tiscene verify`: check the files of an export, and render its frames again."""

from __future__ import annotations

import argparse
from collections.abc import Iterable

from tiscene.cli.terminal import progress
from tiscene.errors import ExportError
from tiscene.export.verification import verify

MAX_LISTED = 8


def run(args: argparse.Namespace) -> None:
    """Verify, and print one line. Raises ExportError if anything differs."""
    with progress(f"verifying {args.folder}", args.sample or 0) as step:
        found = verify(
            args.folder,
            sample=args.sample,
            search=args.search,
            arch=args.arch,
            progress=lambda index: step(task=f"frame {index}"),
        )
    problems = []
    if found.damaged:
        problems.append(f"files of {len(found.damaged)} frames are missing or damaged: {_listed(found.damaged)}")
    if found.different:
        names = sorted({name for buffers in found.different.values() for name in buffers})
        frames = f"{len(found.different)} of {found.rendered} frames render otherwise ({', '.join(names)})"
        problems.append(f"{frames}: {_listed(found.different)}")
    if problems:
        raise ExportError(f"{args.folder}: {'; '.join(problems)}")
    print(f"{found.frames} frames have their files; {found.rendered} rendered again are the same")


def _listed(frames: Iterable[int]) -> str:
    indices = list(frames)
    return ", ".join(map(str, indices[:MAX_LISTED])) + (", ..." if len(indices) > MAX_LISTED else "")
