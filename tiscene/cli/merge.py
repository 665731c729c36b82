# SPDX-License-Identifier: Apache-2.0
"""`tiscene merge`: make one export of shards, or the index of a data set."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiscene.cli.terminal import progress
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.generator import finish
from tiscene.export.merging import merge


def run(args: argparse.Namespace) -> None:
    """Merge, and print the folder."""
    with progress(f"merging into {args.folder}", 0) as step:
        if DataSet.load(Path(args.folder)) is not None and not args.parts:
            finish(args.folder, partial=args.partial)
        else:
            merge(
                args.folder,
                args.parts,
                partial=args.partial,
                unlike=args.unlike,
                progress=lambda index: step(task=f"frame {index}"),
            )
    print(args.folder)
