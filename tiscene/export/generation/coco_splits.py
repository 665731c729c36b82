# SPDX-License-Identifier: Apache-2.0
"""COCO's JSON of a split of a data set: that of all its scenarios in one file, as trainers read it.

`train/annotations/instances.json` and `panoptic.json` are as those of one export, see `tiscene.export.coco`. Names of
pictures are relative to `train`: `000012/images/000003.png`. A video is a scenario, as one camera sees it. Videos,
images, annotations and tracks are numbered on from scenario to scenario.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

from tiscene.errors import StageWarning
from tiscene.export.coco import PACKED
from tiscene.export.generation.split_parts import counter, reading

BLOCK = 1 << 20  # bytes of a file that are in memory


def joined(
    folder: Path, splits: Mapping[str, Sequence[Path]], progress: Callable[[str, float], None] | None = None
) -> Iterator[tuple[str, Iterable[bytes] | None]]:
    """Yield the names of the files of each split, and their contents in parts of which one at a time is in memory.

    None in place of contents where an id is of several categories, with a StageWarning. All splits have the same
    categories. Each file of a scenario is read once.

    Args:
        folder: Folder of the data set.
        splits: Folders of the scenarios, by split.
        progress: Called with a task and the fraction of it that is done.

    Raises:
        ExportError: A file of a scenario is missing or damaged.
    """
    files = {
        f"{split}/{name}": [file for each in scenarios for file in sorted(each.glob(f"**/{name}")) or [each / name]]
        for split, scenarios in splits.items()
        for name in PACKED
    }
    step = counter("joining annotations", sum(map(len, files.values())), progress)
    categories: dict[int, dict[str, Any]] = {}
    with contextlib.ExitStack() as stack:
        targets = {name: _JoinedFile(folder, stack) for name in files}
        for name, parts in files.items():
            for file in parts:
                with reading(folder, file):
                    content = json.loads(file.read_bytes())
                    rows = targets[name].numbered_on(content, "/".join(file.relative_to(folder).parts[1:-2]))
                    conflict = _conflict(categories, content["categories"])
                if conflict:
                    warnings.warn(StageWarning(
                        f"{str(folder)!r} has no annotations of all scenarios together: {conflict}; name all "
                        "categories in the recipe's settings, and generate again"
                    ), stacklevel=2)  # fmt: skip
                    yield from dict.fromkeys(files).items()
                    return
                targets[name].add(rows)
                step()
        ordered = [categories[id] for id in sorted(categories)]
        for name in files:
            yield name, targets[name].content(ordered)


def _conflict(known: dict[int, dict[str, Any]], categories: Iterable[dict[str, Any]]) -> str:
    """Add categories to the known ones by id; return which of them has another name there, as a sentence."""
    for each in categories:
        name = known.setdefault(each["id"], each)["name"]
        if name != each["name"]:
            return f"the category {each['id']} is {name!r} in some and {each['name']!r} in others"
    return ""


class _JoinedFile:
    """A file of a split. Its lists, such as `images`, are in temporary files until all scenarios are added.

    Args:
        folder: Of the data set, which has room for them; not used where it is read-only.
        stack: Closes the temporary files.
    """

    def __init__(self, folder: Path, stack: contextlib.ExitStack) -> None:
        self._folder, self._stack = folder if os.access(folder, os.W_OK) else None, stack
        self._info: Any = None
        self._files: dict[str, IO[bytes]] = {}
        self._videos = 0
        self._last = {"images": 0, "annotations": 0, "tracks": 0}

    def numbered_on(self, content: dict[str, Any], below: str) -> dict[str, list[Any]]:
        """Return the lists of a file of a scenario, with ids after those before, and names of pictures from the split.

        Args:
            content: The file.
            below: The folder of its export in that of the split.
        """
        self._info = self._info or content["info"]
        self._videos += 1
        last = dict(self._last)
        lists = {key: rows for key, rows in content.items() if key not in ("info", "categories")}
        for key, rows in lists.items():
            for row in rows:
                if "id" in row:
                    row["id"] = self._videos if key == "videos" else row["id"] + self._last[key]
                if "video_id" in row:
                    row["video_id"] = self._videos
                if "file_name" in row:
                    row["file_name"] = f"{below}/{'' if key == 'images' else 'panoptic/'}{row['file_name']}"
                for name, kind in (("image_id", "images"), ("track_id", "tracks")):
                    if name in row:
                        row[name] += self._last[kind]
            if key in last:
                last[key] = max((row["id"] for row in rows if "id" in row), default=last[key])
        self._last = last
        return lists

    def add(self, lists: Mapping[str, Sequence[Any]]) -> None:
        """Add what `numbered_on` has returned."""
        for key, rows in lists.items():
            if key not in self._files:
                temporary = tempfile.TemporaryFile(dir=self._folder)  # noqa: SIM115
                self._files[key] = self._stack.enter_context(temporary)
            if rows:
                file = self._files[key]
                separator = ",\n" if file.tell() else "\n"
                file.write((separator + ",\n".join(json.dumps(row, separators=(",", ":")) for row in rows)).encode())
                file.flush()  # closing it cannot fail then

    def content(self, categories: list[dict[str, Any]]) -> Iterator[bytes]:
        """Yield the content of the file in parts."""
        yield f'{{"info":{json.dumps(self._info)},"categories":{json.dumps(categories)}'.encode()
        for key, file in self._files.items():
            yield f',"{key}":['.encode()
            file.seek(0)
            while block := file.read(BLOCK):
                yield block
            yield b"]"
        yield b"}\n"
