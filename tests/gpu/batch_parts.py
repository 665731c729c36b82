# SPDX-License-Identifier: Apache-2.0
"""Parts of `python -m tests.gpu` for frames in batches, and for steps that one GPU thread must not do alone."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import taichi as ti

from tests.gpu.baked_scene import LABEL_SIZE, LABELS, BakedScene
from tests.gpu.checks import Check, median
from tiscene.device import runtime
from tiscene.device.kernel_types import float8
from tiscene.device.memory import device_array, upload, upload_vectors
from tiscene.device.prefix_sums import scans_in_blocks
from tiscene.render.integrators.incremental.mover_culling import cull_rays
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.integrators.path.path_frames import PathFrames
from tiscene.render.integrators.path.path_image import PathImage
from tiscene.render.integrators.path.path_pass import PathPass
from tiscene.render.integrators.path.path_state import LIGHT_PENDING, LIVE, chunks_for
from tiscene.render.integrators.path.wavefront_kernels import compact_queue
from tiscene.scene.placement import CURRENT, NEXT, PREVIOUS, Placement

SIZE = 256, 192
TIMED = ("instance", "semantic", "depth", "forward_flow")  # label buffers whose time is taken
BATCHED_SIZE = 64, 48  # of colors
TIME = (PREVIOUS, CURRENT, NEXT)


def batch(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Labels of several frames in one launch: the bytes of frames one by one, and the speed of both."""
    count = max(2, int(16 * scale))
    for scene in scenes:
        device, passes = scene.device_scene(), LabelPass(scene.device_scene())
        placements = [scene.placements[frame % len(scene.placements)] for frame in range(count)]
        single = LabelPass(device)

        def one_by_one(size: tuple[int, int], names: tuple[str, ...], turned: float) -> list[dict[str, Any]]:
            found = []
            for frame, placement in enumerate(placements):  # noqa: B023
                device.place(placement, times=TIME)  # noqa: B023
                found.append(single.render(scene.view(size, turned=turned + 0.02 * frame), names))  # noqa: B023
            return found

        def at_once(size: tuple[int, int], names: tuple[str, ...], turned: float) -> list[dict[str, Any]]:
            views = [scene.view(size, turned=turned + 0.02 * frame) for frame in range(count)]  # noqa: B023
            return passes.render_frames(views, placements, names) or []  # noqa: B023

        expected, found = one_by_one(LABEL_SIZE, LABELS, 0.0), at_once(LABEL_SIZE, LABELS, 0.0)
        same = len(found) == count and all(
            one[name].tobytes() == other[name].tobytes()
            for one, other in zip(found, expected, strict=True)
            for name in LABELS
        )
        yield Check(f"{scene.name}: {count} frames at once", "same bytes" if same else "differ", same)
        for name, render, goal in (("one by one", one_by_one, ""), ("at once", at_once, " (goal: 0.5 ms)")):
            turns = itertools.count()
            seconds = median(lambda: render(SIZE, TIMED, 0.5 * next(turns)), 5) / count  # noqa: B023
            yield Check(f"{scene.name}: labels, 256x192, {name}", f"{1e3 * seconds:.2f} ms a frame{goal}")


def batch_colors(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Path tracing of several frames in one launch: the bytes of frames one by one, and the speed of both."""
    count, sampling = max(2, int(8 * scale)), {"seed": 1, "spp": 4, "max_depth": 6}
    for scene in scenes:
        device = scene.device_scene()
        single, stacked = PathPass(device, *BATCHED_SIZE), PathFrames(scene.device_scene(), *BATCHED_SIZE)
        placements = [scene.placements[frame % len(scene.placements)] for frame in range(count)]
        views = [scene.view(BATCHED_SIZE, turned=0.02 * frame) for frame in range(count)]

        def one_by_one() -> list[PathImage]:
            found = []
            for frame, (view, placement) in enumerate(zip(views, placements, strict=True)):  # noqa: B023
                device.place(placement)  # noqa: B023
                found.append(single.render(view, frame_index=frame, **sampling))  # noqa: B023
            return found

        def at_once() -> list[PathImage] | None:
            return stacked.render_frames(views, placements, range(count), **sampling)  # noqa: B023

        found = at_once()
        if found is None:
            yield Check(f"{scene.name}: colors", "lights change between frames: rendered one by one")
            continue
        same = all(one.hdr.tobytes() == other.hdr.tobytes() for one, other in zip(found, one_by_one(), strict=True))
        yield Check(f"{scene.name}: colors of {count} frames at once", "same bytes" if same else "differ", same)
        for name, render in (("one by one", one_by_one), ("at once", at_once)):
            seconds = median(render, 3) / count
            yield Check(f"{scene.name}: 4 spp, 64x48, {name}", f"{1e3 * seconds:.2f} ms a frame")


def serial(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Steps of a frame that one GPU thread must not do alone (risk 2), and the build of the trees."""
    limit = 2.0 if runtime.running() == "cuda" else math.inf
    count = 1 << 20
    random = np.random.default_rng(3)
    status = random.choice([0, LIVE, LIGHT_PENDING, LIVE | LIGHT_PENDING], count)
    arrays = [upload(each) for each in (status, np.arange(count), np.zeros(count, int), np.zeros(count, int))]
    chunks = [upload(np.zeros(chunks_for(count), np.int32)) for _ in range(2)]
    compacted = arrays[0], arrays[1], count, arrays[2], arrays[3], *chunks, scans_in_blocks()
    sizes = compact_queue(*compacted)
    right = (sizes & 0xFFFFFFFF, sizes >> 32) == tuple(int((status & flag > 0).sum()) for flag in (LIVE, LIGHT_PENDING))
    milliseconds = 1e3 * median(lambda: compact_queue(*compacted), 10)
    yield Check("queue of 2^20 paths compacted", f"{milliseconds:.2f} ms", right and milliseconds < limit)
    boxes = device_array(float8, 6)
    boxes.from_numpy(np.repeat([[-1.0], [-1.0], [-1.0], [1.0], [1.0], [1.0]], 8, axis=1).astype(np.float32))
    rays = np.zeros((count, 8), np.float32)
    rays[:, 0], rays[:, 2], rays[:, 6], rays[:, 7] = random.uniform(-3.0, 3.0, count), -5.0, 1.0, np.inf
    near, rows = upload(np.zeros(count, int)), upload(np.zeros(count, int))
    culled = upload_vectors(rays), count, boxes, near, rows, upload(np.zeros(chunks_for(count), int)), scans_in_blocks()
    right = cull_rays(*culled) == int((np.abs(rays[:, 0]) <= 1.0).sum())
    milliseconds = 1e3 * median(lambda: cull_rays(*culled), 10)
    yield Check("2^20 rays culled by boxes", f"{milliseconds:.2f} ms", right and milliseconds < limit)
    for scene in scenes:
        began = time.perf_counter()
        device = scene.device_scene()
        ti.sync()
        yield Check(f"{scene.name}: scene made", f"{time.perf_counter() - began:.2f} s")
        moved = [_shifted(scene.placements[0], 0.001 * step) for step in range(1, 8)]
        steps = itertools.cycle(moved)
        milliseconds = 1e3 * median(lambda: device.place(next(steps), times=TIME), 10)  # noqa: B023
        yield Check(f"{scene.name}: all instances placed", f"{milliseconds:.2f} ms", milliseconds < 10.0 * limit)


def _shifted(placement: Placement, by: float) -> Placement:
    """Return a placement in which all instances are shifted, m."""
    world = placement.world_from_object.copy()
    world[..., 3] += by
    return replace(placement, world_from_object=world)
