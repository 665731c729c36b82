# SPDX-License-Identifier: Apache-2.0
"""COCO's JSON of a split of a data set: that of all its scenarios in one file, as trainers read it.

`train/annotations/instances.json` and `panoptic.json` are as those of one export, see `tiscene.export.coco`. Names of
pictures are relative to `train`: `000012/images/000003.png`. A video is a scenario, as one camera sees it. Videos,
images, annotations and tracks are numbered on from scenario to scenario.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tiscene.errors import ExportError, StageWarning
from tiscene.export.coco import PACKED


def joined(folder: Path, splits: Mapping[str, Sequence[Path]]) -> dict[str, Iterator[bytes] | None]:
    """Return the contents of the files of each split by name, in parts of which one at a time is in memory.

    None where an id is of several categories, with a StageWarning. All splits have the same categories.

    Args:
        folder: Folder of the data set.
        splits: Folders of the scenarios, by split.

    Raises:
        ExportError: A file of a scenario is missing or damaged, also while the contents are read.
    """
    files = {
        f"{split}/{name}": [file for each in scenarios for file in sorted(each.glob(f"**/{name}")) or [each / name]]
        for split, scenarios in splits.items()
        for name in PACKED
    }
    categories: dict[int, dict[str, Any]] = {}
    for file in (file for name in files if name.endswith(PACKED[0]) for file in files[name]):
        for category in _read(folder, file)["categories"]:
            known = categories.setdefault(category["id"], category)
            if known["name"] != category["name"]:
                warnings.warn(StageWarning(
                    f"{str(folder)!r} has no annotations of all scenarios together: the category {category['id']} is "
                    f"{known['name']!r} in some and {category['name']!r} in others; name all categories in the "
                    "recipe's settings, and generate again"
                ), stacklevel=2)  # fmt: skip
                return dict.fromkeys(files)
    ordered = [categories[id] for id in sorted(categories)]
    return {name: _content(folder, parts, ordered) for name, parts in files.items()}


def _content(folder: Path, files: Sequence[Path], categories: list[dict[str, Any]]) -> Iterator[bytes]:
    """Yield the content of a file."""
    first = _read(folder, files[0])
    yield f'{{"info":{json.dumps(first["info"])},"categories":{json.dumps(categories)}'.encode()
    for key in first:
        if key not in ("info", "categories"):
            yield f',"{key}":['.encode()
            separator = "\n"
            for part in _numbered_on(folder, files):
                for row in part[key]:
                    yield (separator + json.dumps(row, separators=(",", ":"))).encode()
                    separator = ",\n"
            yield b"]"
    yield b"}\n"


def _numbered_on(folder: Path, files: Sequence[Path]) -> Iterator[dict[str, Any]]:
    """Yield what each file has, with ids after those of the file before, and pictures named from the split on."""
    last = {"images": 0, "annotations": 0, "tracks": 0}
    for video, file in enumerate(files, 1):
        content, below = _read(folder, file), "/".join(file.relative_to(folder).parts[1:-2])
        offsets = {"image_id": last["images"], "track_id": last["tracks"]}
        for key in content.keys() - {"info", "categories"}:
            pictures = below if key == "images" else f"{below}/panoptic"
            for row in content[key]:
                if "id" in row:
                    row["id"] = video if key == "videos" else row["id"] + last[key]
                if "video_id" in row:
                    row["video_id"] = video
                if "file_name" in row:
                    row["file_name"] = f"{pictures}/{row['file_name']}"
                for name in offsets.keys() & row.keys():
                    row[name] += offsets[name]
        for key in last.keys() & content.keys():
            last[key] = max((row["id"] for row in content[key] if "id" in row), default=last[key])
        yield content


def _read(folder: Path, file: Path) -> dict[str, Any]:
    try:
        content: dict[str, Any] = json.loads(file.read_bytes())
        return content
    except (OSError, ValueError) as error:
        scenario = str(folder.joinpath(*file.relative_to(folder).parts[:2]))
        raise ExportError(f"{str(file)!r} is missing or damaged: delete {scenario!r}, and generate again") from error
