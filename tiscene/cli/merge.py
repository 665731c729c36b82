# SPDX-License-Identifier: Apache-2.0
"""`tiscene merge`: make one export of shards."""

from __future__ import annotations

import argparse

from tiscene.cli.terminal import progress
from tiscene.export.merging import merge


def run(args: argparse.Namespace) -> None:
    """Merge, and print the folder."""
    with progress(f"merging into {args.folder}", 0) as step:
        merge(
            args.folder,
            args.parts,
            partial=args.partial,
            unlike=args.unlike,
            progress=lambda index: step(task=f"frame {index}"),
        )
    print(args.folder)
