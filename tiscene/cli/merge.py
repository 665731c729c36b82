# SPDX-License-Identifier: Apache-2.0
"""`tiscene merge`: make one export of shards, or the index of a data set."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiscene.cli.terminal import progress
from tiscene.export.distributed.worker_processes import frames_in
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.generator import finish
from tiscene.export.merging import merge, part_folders


def run(args: argparse.Namespace) -> None:
    """Merge, and print the folder."""
    folder = Path(args.folder)
    if DataSet.load(folder) is not None and not args.parts:
        finish(folder, partial=args.partial)
    else:
        parts = part_folders(folder, args.parts)
        with progress(f"merging into {folder}", frames_in(parts)) as step:
            merge(
                folder,
                parts,
                partial=args.partial,
                unlike=args.unlike,
                progress=lambda index: step(task=f"frame {index}"),
            )
    print(args.folder)
