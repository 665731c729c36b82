# SPDX-License-Identifier: Apache-2.0
"""Contents of the folders of exports, to be compared."""

from __future__ import annotations

from pathlib import Path

from tiscene.export.rerun_recording import content_digest as rrd_digest
from tiscene.export.shards import SHARDS


def contents(folder: Path) -> dict[str, bytes | str | None]:
    """Return files by name; of Rerun's recordings, whose bytes differ, the digest of their chunks."""
    return {
        str(path.relative_to(folder)): rrd_digest(path) if path.suffix == ".rrd" else path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def merged(folder: Path) -> dict[str, bytes | str | None]:
    """Return the contents of a folder without its shards."""
    return {name: data for name, data in contents(folder).items() if not name.startswith(SHARDS)}
