# SPDX-License-Identifier: Apache-2.0
"""COCO: boxes, masks and tracks in `annotations/instances.json`, panoptic segments in `annotations/panoptic.json`.

Pictures are `images/000012.png`; `panoptic/000012.png` has the ids of the segments as R + 256 G + 65536 B. An
annotation is a visible object with a category: `bbox` (x, y, width, height), `area` (px), `segmentation` (compressed
RLE, column by column), `iscrowd` 0, and, for tracking (TAO, YouTube-VIS), `track_id` and `video_id`; `instance` is its
value in the buffer of that name. Ids begin with 1: the image of frame k is k + 1. Stuff (walls, floors, ceilings) has
`isthing` 0 and panoptic segments alone, one for all of a category. What has no category is void: 0 in `panoptic`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents, png

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, FramePieces
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = None
PACKED = ("annotations/instances.json", "annotations/panoptic.json")
STUFF = frozenset({"ceiling", "cornice", "floor", "skirting", "wall"})  # categories without countable instances


def encode(frame: Frame) -> dict[str, Contents]:
    """Return the pictures of a frame by name."""
    return {
        f"images/{frame.index:06d}.png": partial(png, frame.rgb),
        f"panoptic/{frame.index:06d}.png": lambda: _panoptic(_segments(frame)),
    }


def _segments(frame: Frame) -> NDArray[np.int32]:
    """Return the id of the panoptic segment of each pixel: of its object, or of the first one of its kind of stuff."""
    table = np.zeros(1 + max(int(frame.instance.max(initial=0)), *(row.id for row in frame.objects), 0), np.int32)
    stuff: dict[int, int] = {}
    for row in frame.objects:
        if row.category_id:
            table[row.id] = stuff.setdefault(row.category_id, row.id) if row.category in STUFF else row.id
    segments: NDArray[np.int32] = table[frame.instance]
    return segments


def _panoptic(segments: NDArray[np.int32]) -> bytes:
    """Return the picture of the ids of segments."""
    ids = np.ascontiguousarray(segments, "<i4").view(np.uint8).reshape(*segments.shape, 4)
    return png(np.ascontiguousarray(ids[..., :3]))


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the image and the annotations of a frame as JSON; ids of annotations are given by `pack`."""
    return {"coco.json": lambda: _annotations(frame)}


def _annotations(frame: Frame) -> bytes:
    """Return what a frame adds to the two JSON files."""
    height, width = frame.instance.shape
    names = {"id": frame.index + 1, "width": width, "height": height, "frame_index": frame.index}
    image = names | {"file_name": f"images/{frame.index:06d}.png", "video_id": 1, "time": frame.time}
    annotations, segments = [], []
    categories = {row.id: row for row in frame.objects if row.category_id}
    for id, (counts, box) in runs_of_objects(_segments(frame)).items():
        row, area = categories[id], int(counts[1::2].sum())
        about = {"category_id": row.category_id, "bbox": list(box), "area": area, "iscrowd": 0}
        segments.append({"id": id, **about})
        if row.category in STUFF:
            continue
        mask = {"size": [height, width], "counts": rle(counts)}
        track = {"image_id": frame.index + 1, "video_id": 1, "track_id": id, "instance": id, "name": row.name}
        annotations.append({**track, **about, "segmentation": mask})
    panoptic = {
        "image_id": frame.index + 1,
        "file_name": f"{frame.index:06d}.png",
        "segments_info": segments,
    }
    tracks = [
        {"id": id, "category_id": row.category_id, "video_id": 1}
        for id, row in categories.items()
        if row.category not in STUFF
    ]
    content = {"image": image, "annotations": annotations, "panoptic": panoptic, "tracks": tracks}
    return json.dumps(content, separators=(",", ":")).encode()


def pack(frames: Iterable[FramePieces], run: ExportRun, folder: Path) -> None:
    """Write the two JSON files, a frame at a time."""
    target = folder / "annotations"
    target.mkdir(parents=True)
    categories = [
        {"id": id, "name": name, "isthing": int(name not in STUFF)} for id, name in sorted(run.categories.items()) if id
    ]
    info = {"description": f"tiscene {run.provenance['tiscene']}", "version": "1.0"}
    scene = str(run.provenance["scenario"].get("scene", ""))
    videos = [{"id": 1, "name": scene, "fps": run.fps, "length": len(run.frames)}]
    tracks: dict[int, Any] = {}
    count = 0
    with (target / "instances.json").open("w") as instances, (target / "panoptic.json").open("w") as panoptic:
        instances.write(f'{{"info":{json.dumps(info)},"categories":{json.dumps(categories)},')
        instances.write(f'"videos":{json.dumps(videos)},"images":[')
        _write_list(instances, (_content(frame)["image"] for frame in frames))
        instances.write('],"annotations":[')
        for frame in frames:
            content = _content(frame)
            tracks |= {track["id"]: track for track in content["tracks"]}
            for annotation in content["annotations"]:
                instances.write(",\n" if count else "\n")
                count += 1
                json.dump({"id": count} | annotation, instances, separators=(",", ":"))
        instances.write('],"tracks":[')
        _write_list(instances, (tracks[id] for id in sorted(tracks)))
        instances.write("]}\n")
        panoptic.write(f'{{"info":{json.dumps(info)},"categories":{json.dumps(categories)},"images":[')
        _write_list(panoptic, (_content(frame)["image"] for frame in frames))
        panoptic.write('],"annotations":[')
        _write_list(panoptic, (_content(frame)["panoptic"] for frame in frames))
        panoptic.write("]}\n")


def runs_of_objects(
    instance: NDArray[np.int32],
) -> dict[int, tuple[NDArray[np.int64], tuple[int, int, int, int]]]:
    """Return the run lengths and the box of each object in an image.

    Args:
        instance: int32 [h, w]; 0 is the background.

    Returns:
        By id: lengths of runs of 0, 1, 0, ... down the columns, int64 [n]; and x, y, width, height.
    """
    height = instance.shape[0]
    flat = instance.ravel(order="F")
    starts = np.concatenate(([0], np.flatnonzero(flat[1:] != flat[:-1]) + 1))
    ends = np.append(starts[1:], flat.size)
    ids = flat[starts]
    order = np.argsort(ids, kind="stable")
    found = {}
    for rows in np.split(order, np.flatnonzero(np.diff(ids[order])) + 1):
        id, first, end = int(ids[rows[0]]), starts[rows], ends[rows]
        if id == 0:
            continue
        edges = np.concatenate(([0], np.stack([first, end], axis=1).ravel(), [flat.size]))
        counts = np.diff(edges)
        if counts[-1] == 0:
            counts = counts[:-1]
        x0, x1 = int(first[0] // height), int((end[-1] - 1) // height)
        if (first // height == (end - 1) // height).all():
            y0, y1 = int((first % height).min()), int(((end - 1) % height).max())
        else:  # a run goes on in the next column: it has the lowest and the highest row
            y0, y1 = 0, height - 1
        found[id] = counts, (x0, y0, x1 - x0 + 1, y1 - y0 + 1)
    return found


def rle(counts: NDArray[np.int64]) -> str:
    """Return run lengths as COCO's compressed text: from the third on as differences to the one before the last.

    Each number has groups of 5 bits, lowest first, with a sixth bit where more follow, as characters from "0" on
    (the format of `rleToString` in COCO's API).
    """
    rest = counts.copy()
    rest[3:] -= counts[1:-2]
    groups: list[NDArray[np.int64]] = []
    goes_on = np.ones(len(rest), bool)
    while goes_on.any():
        bits = rest & 31
        rest = rest >> 5
        ends = rest == np.where(bits & 16, -1, 0)
        groups.append(np.where(goes_on, np.where(ends, bits, bits | 32) + 48, 0))
        goes_on &= ~ends
    text = np.stack(groups, axis=1).astype(np.uint8)
    return text[text > 0].tobytes().decode()


def _content(frame: FramePieces) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(frame.members["coco.json"])
    return content


def _write_list(target: Any, values: Iterable[Any]) -> None:
    for place, value in enumerate(values):
        target.write(",\n" if place else "\n")
        json.dump(value, target, separators=(",", ":"))
