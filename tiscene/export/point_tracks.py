# SPDX-License-Identifier: Apache-2.0
"""Point tracks with exact visibility, in TAP-Vid's layout: `tracks/000000.npz` has the clip of frames 0 to 23.

=====================  =======================================================================================
`video`                uint8 [frames, h, w, 3], if the stream has `rgb`
`query_points`         float32 [points, 3]: frame of the clip, y, x, px; pixel centers at halves
`target_points`        float32 [points, frames, 2]: x, y, px; also where the point is hidden or out of view
`occluded`             bool [points, frames]: True where the point is not visible
`instance`             int32 [points]: id of the object that the point is on
`frames`               int64 [frames]: indices of the frames in the stream
=====================  =======================================================================================

Points are chosen in the first and in the middle frame of a clip, as many of each visible object, by random numbers that
depend on seed and clip alone. Each is a point of a surface, which moves and deforms with it. Where it is in another
frame, and whether it is visible there, is the flow and the occlusion of the label pass from that frame: a ray, and no
comparison of depths. A clip has those of its 24 frames that are exported.
Doersch et al., "TAP-Vid: A Benchmark for Tracking Any Point in a Video", 2022.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents, archive, from_npy, npy
from tiscene.render.view import View
from tiscene.scene.camera import Camera
from tiscene.scene.placement import Placement

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, FramePieces
    from tiscene.frame.frame import Frame
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = 24
QUERY_FRAMES = (0, 12)  # of a clip
POINTS = 128  # per query frame


@dataclass(frozen=True, eq=False)
class Query:
    """Points that are chosen in a frame.

    Attributes:
        frame: Index of the frame.
        now: The camera at that frame.
        after: The camera at the next one.
        placement: The instances at that frame.
        x: Columns of their pixels, int64 [n].
        y: Rows of their pixels, int64 [n].
        instance: Ids of their objects, int32 [n].
    """

    frame: int
    now: Camera
    after: Camera
    placement: Placement
    x: NDArray[np.int64]
    y: NDArray[np.int64]
    instance: NDArray[np.int32]


# Of each stream, those that were asked for last: choosing them takes as long as rendering.
_queries: WeakKeyDictionary[Stream, dict[tuple[int, ...], Query]] = WeakKeyDictionary()
_KEPT_QUERIES = 8


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the picture, and where the clip's points are in the frame."""
    clip = frame.index // FRAMES_PER_FILE
    state = stream.world.state(frame.index)
    cameras = [step.current for step in state.cameras]
    row = [camera.name for camera in cameras].index(frame.camera.camera.name)
    queries = [query_points(stream, row, clip * FRAMES_PER_FILE + query) for query in QUERY_FRAMES]
    tracks = [query_tracks(stream, query, frame.index, cameras[row], state.placement) for query in queries]
    columns = {name: np.concatenate([track[name] for track in tracks]) for name in tracks[0]}
    video: dict[str, Contents] = {"rgb": partial(npy, frame.rgb)} if "rgb" in frame else {}
    return video | {name: npy(column) for name, column in columns.items()}


def query_points(stream: Stream, row: int, index: int) -> Query:
    """Return the points that are chosen in a frame.

    Args:
        stream: The stream.
        row: Of the camera.
        index: Of the frame.
    """
    known = _queries.setdefault(stream, {})
    key = row, index, stream.width, stream.height, len(stream.scenario.edits)
    if key not in known:
        state = stream.world.state(index)
        view = View(*state.cameras[row], width=stream.width, height=stream.height)
        instance = stream.render_view(index, view, ("instance",)).instance
        x, y = chosen_pixels(instance, np.random.default_rng([stream.seed, index, row]))
        while len(known) >= _KEPT_QUERIES:
            del known[next(iter(known))]
        known[key] = Query(index, view.current, view.next, state.placement, x, y, instance[y, x])
    return known[key]


def query_tracks(
    stream: Stream, query: Query, frame: int, camera: Camera, placement: Placement
) -> dict[str, NDArray[Any]]:
    """Return where the points of a query are in a frame.

    Args:
        stream: The stream.
        query: The points.
        frame: Index of the frame.
        camera: The camera at the frame.
        placement: The instances at the frame.

    Returns:
        `query` float32 [n, 3]: frame of the clip, y, x; `target` float32 [n, 2]: x, y; `occluded` bool [n]; `instance`
        int32 [n].
    """
    x, y = query.x, query.y
    centers = np.stack([x + 0.5, y + 0.5], axis=1)
    if query.frame == frame:
        target, occluded = centers, np.zeros(len(x), bool)
    else:
        view = View(camera, query.now, query.after, width=stream.width, height=stream.height)
        pixels = np.zeros((stream.height, stream.width), bool)
        pixels[y, x] = True
        moved = query.placement.including(placement).since(placement)  # what came later may occlude
        seen = stream.label_pixels(moved, view, ("backward_flow", "backward_occlusion"), pixels)
        target, occluded = centers + seen["backward_flow"][y, x], seen["backward_occlusion"][y, x]
    place = np.full(len(x), query.frame % FRAMES_PER_FILE)
    return {
        "query": np.stack([place, y + 0.5, x + 0.5], axis=1).astype(np.float32),
        "target": target.astype(np.float32),
        "occluded": occluded,
        "instance": query.instance,
    }


def chosen_pixels(
    instance: NDArray[np.int32], random: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the x and y of up to POINTS pixels, as evenly among the objects as their sizes permit; none of 0."""
    ids = instance.ravel()
    order = random.permutation(np.flatnonzero(ids))
    order = order[np.argsort(ids[order], kind="stable")]
    _, first = np.unique(ids[order], return_index=True)
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
    chosen = np.sort(order[np.argsort(rank, kind="stable")][:POINTS])
    return chosen % instance.shape[1], chosen // instance.shape[1]


def pack(frames: Iterable[FramePieces], run: ExportRun, folder: Path) -> None:
    """Write one clip."""
    clip = [(frame.index, {name: from_npy(data) for name, data in frame.members.items()}) for frame in frames]
    first = clip[0][1]
    arrays = {
        "query_points": first["query"],
        "target_points": np.stack([each["target"] for _, each in clip], axis=1),
        "occluded": np.stack([each["occluded"] for _, each in clip], axis=1),
        "instance": first["instance"],
        "frames": np.array([index for index, _ in clip], np.int64),
    }
    if "rgb" in first:
        arrays["video"] = np.stack([each["rgb"] for _, each in clip])
    path = folder / f"tracks/{clip[0][0] // FRAMES_PER_FILE:06d}.npz"
    path.parent.mkdir(parents=True)
    path.write_bytes(archive({f"{name}.npy": npy(array) for name, array in arrays.items()}, compress=True))
