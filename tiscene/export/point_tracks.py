# SPDX-License-Identifier: Apache-2.0
"""Point tracks with exact visibility, in TAP-Vid's layout: `tracks/000000.npz` has the clip of frames 0 to 23.

=====================  =======================================================================================
`video`                uint8 [frames, h, w, 3], if the stream has `rgb`
`query_points`         float32 [points, 3]: frame (its place in the arrays), y, x, px; pixel centers at halves
`target_points`        float32 [points, frames, 2]: x, y, px; also where the point is hidden or out of view
`occluded`             bool [points, frames]: True where the point is not visible
`instance`             int32 [points]: id of the object that the point is on
`frames`               int64 [frames]: indices of the frames in the stream
=====================  =======================================================================================

Points are chosen in the first and in the middle frame of a clip, as many of each visible object, by random numbers that
depend on seed and clip alone. Each is a point of a surface, which moves and deforms with it. Where it is in another
frame, and whether it is visible there, is decided as flow and occlusion are in the label pass: by a ray, without a
comparison of depths. A clip has those of its 24 frames that are exported, and the points that were chosen in them.
Doersch et al., "TAP-Vid: A Benchmark for Tracking Any Point in a Video", 2022.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from tiscene.export.array_files import Contents, archive, from_npy, npy
from tiscene.render.view import View

if TYPE_CHECKING:
    from tiscene.export.packing import ExportRun, GroupFrames
    from tiscene.frame.frame import Frame
    from tiscene.render.integrators.labels.point_pass import SurfacePoints
    from tiscene.scene.placement import Placement
    from tiscene.stream.stream import Stream

FRAMES_PER_FILE = 24
PACKED = ("tracks/*.npz",)
QUERY_FRAMES = (0, 12)  # of a clip
POINTS = 128  # per query frame


@dataclass(frozen=True, eq=False)
class Query:
    """Points that are chosen in a frame.

    Attributes:
        frame: Index of the frame.
        points: The points.
        instance: Ids of their objects, int32 [n].
    """

    frame: int
    points: SurfacePoints
    instance: NDArray[np.int32]


# Of each world, those that were asked for last: choosing them takes as long as rendering.
_queries: WeakKeyDictionary[Any, dict[tuple[int, ...], Query]] = WeakKeyDictionary()
_KEPT_QUERIES = 8


def pieces(frame: Frame, labels: dict[str, Any], stream: Stream) -> dict[str, Contents]:
    """Return the picture, and where the clip's points are in the frame."""
    clip = frame.index // FRAMES_PER_FILE
    state = stream.world.state(frame.index)
    row = [step.current.name for step in state.cameras].index(frame.camera.camera.name)
    view = View(*state.cameras[row], width=stream.width, height=stream.height)
    queries = [query_points(stream, row, clip * FRAMES_PER_FILE + query) for query in QUERY_FRAMES]
    tracks = [query_tracks(stream, query, frame.index, state.placement, view) for query in queries]
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
    known = _queries.setdefault(stream.world, {})
    key = row, index, stream.width, stream.height, stream.world.edit_count
    if key not in known:
        state = stream.world.state(index)
        view = View(*state.cameras[row], width=stream.width, height=stream.height)
        instance = stream.render_view(index, view, ("instance",)).instance
        x, y = chosen_pixels(instance, np.random.default_rng([stream.seed, index, row]))
        while len(known) >= _KEPT_QUERIES:
            del known[next(iter(known))]
        known[key] = Query(index, stream.surface_points(state.placement, view, x, y), instance[y, x])
    return known[key]


def query_tracks(stream: Stream, query: Query, frame: int, placement: Placement, view: View) -> dict[str, NDArray[Any]]:
    """Return where the points of a query are in a frame.

    Args:
        stream: The stream.
        query: The points.
        frame: Index of the frame.
        placement: The instances at the frame.
        view: The camera at the frame.

    Returns:
        `query` float32 [n, 3]: frame of the clip, y, x; `target` float32 [n, 2]: x, y; `occluded` bool [n]; `instance`
        int32 [n].
    """
    chosen = query.points.pixels
    if query.frame == frame:
        target, occluded = chosen, np.zeros(len(chosen), bool)
    else:
        target, occluded = stream.follow(query.points, placement, view)
    place = np.full(len(chosen), query.frame % FRAMES_PER_FILE)
    return {
        "query": np.column_stack([place, chosen[:, ::-1]]).astype(np.float32),
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


def pack(frames: GroupFrames, run: ExportRun, folder: Path) -> None:
    """Write one clip."""
    clip = [(frame.index, {name: from_npy(data) for name, data in frame.members.items()}) for frame in frames]
    first, indices = clip[0][1], np.array([index for index, _ in clip], np.int64)
    query = first["query"].copy()
    chosen_in = frames.first // FRAMES_PER_FILE * FRAMES_PER_FILE + query[:, 0].astype(np.int64)
    query[:, 0] = np.searchsorted(indices, chosen_in)
    exported = np.isin(chosen_in, indices)
    arrays = {
        "query_points": query[exported],
        "target_points": np.stack([each["target"] for _, each in clip], axis=1)[exported],
        "occluded": np.stack([each["occluded"] for _, each in clip], axis=1)[exported],
        "instance": first["instance"][exported],
        "frames": indices,
    }
    if "rgb" in first:
        arrays["video"] = np.stack([each["rgb"] for _, each in clip])
    path = folder / f"tracks/{frames.first // FRAMES_PER_FILE:06d}.npz"
    path.parent.mkdir(parents=True)
    path.write_bytes(archive({f"{name}.npy": npy(array) for name, array in arrays.items()}))
