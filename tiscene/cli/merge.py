# SPDX-License-Identifier: Apache-2.0
"""`tiscene merge`: make one export of shards, or the index of a data set."""

from __future__ import annotations

import argparse
from pathlib import Path

from tiscene.cli.generate import status_of
from tiscene.cli.terminal import progress, task_shown
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.generator import finish
from tiscene.export.manifest import listed_frames
from tiscene.export.merging import merge, part_folders


def run(args: argparse.Namespace) -> int:
    """Merge, and print the folder.

    Returns:
        The exit status.
    """
    folder = Path(args.folder)
    data_set = DataSet.load(folder)
    if data_set is not None and not args.parts:
        with progress(f"indexing {folder}", 0) as step:
            finish(folder, partial=args.partial, progress=task_shown(step))
        status = status_of(data_set, range(data_set.count))
    else:
        status = 0
        parts = part_folders(folder, args.parts)
        with progress(f"merging into {folder}", len(listed_frames(*parts))) as step:
            merge(
                folder,
                parts,
                partial=args.partial,
                unlike=args.unlike,
                overwrite=args.overwrite,
                progress=lambda index: step(task=f"frame {index}"),
            )
    print(args.folder)
    return status
