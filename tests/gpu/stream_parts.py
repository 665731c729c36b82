# SPDX-License-Identifier: Apache-2.0
"""A part of `python -m tests.gpu` for what users run: streams of a room, with a camera that moves and three movers."""

from __future__ import annotations

import importlib.util
import itertools
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.gpu.baked_scene import BakedScene
from tests.gpu.batch_parts import TIMED
from tests.gpu.checks import Check
from tiscene.device import runtime

ROOM, TEMPLATES = "room_02", ("Cube", "Sphere", "Torus")
COLORS = ("rgb", *TIMED)
FRAMES = 48
SMALL, LARGE = {"width": 256, "height": 192}, {"width": 640, "height": 480}
TRACED = {"buffers": COLORS, "quality": "standard", "incremental": False}
# Settings of each stream, and the goal of an H200.
STREAMS: dict[str, tuple[dict[str, Any], str]] = {
    "labels": ({"buffers": TIMED, **SMALL}, "500"),
    "labels, batch=16": ({"buffers": TIMED, "batch": 16, **SMALL}, "2,000"),
    "4 spp": ({"spp": 4, **TRACED, **SMALL}, "60"),
    "4 spp, batch=8": ({"spp": 4, "batch": 8, **TRACED, **SMALL}, "60"),
    "16 spp, 640x480": ({"spp": 16, **TRACED, **LARGE}, "10"),
    "fast": ({"buffers": COLORS, "quality": "fast", **SMALL}, ""),
    "preview": ({"buffers": COLORS, "quality": "preview", **SMALL}, ""),
}


def streams(scenes: list[BakedScene], scale: float) -> Iterator[Check]:
    """Frames per second of streams, medians, after a first frame; needs OpenUSD and the rooms."""
    try:
        import pxr  # noqa: F401
    except ImportError:
        yield Check("OpenUSD", "not installed")
        return
    import tiscene as ts

    has_denoiser = importlib.util.find_spec("pyoidn") is not None
    yield Check("denoiser", "installed" if has_denoiser else "not installed: colors are not denoised")
    scenario, frames = _scenario(), max(2, int(FRAMES * scale))
    for name, (settings, goal) in STREAMS.items():
        count, batch = (frames // 4 if "640" in name else frames), settings.get("batch", 1)
        if "rgb" in settings["buffers"] and not has_denoiser:
            settings = {**settings, "denoise": False}
        began = time.perf_counter()
        with ts.Stream(scenario, arch=runtime.running(), **settings) as stream:
            iterator = iter(stream)
            next(iterator)
            first = time.perf_counter() - began
            for _ in range(batch - 1):  # the rest of its batch
                next(iterator)
            times = []
            for _ in range(max(1, count // batch)):
                start = time.perf_counter()
                shown = [np.count_nonzero(frame.instance) for frame in itertools.islice(iterator, batch)]
                times.append((time.perf_counter() - start) / batch)
        aim = f" (goal: {goal})" if goal else ""
        text = f"{1.0 / np.median(times):.3g} frames/s{aim}, first frame after {first:.1f} s"
        yield Check(name, text, all(shown))


def _scenario() -> Any:
    """Return the room with three objects that circle, seen by a camera that does."""
    import tiscene as ts

    start = ts.Stream(ROOM, width=64, height=48, buffers=("depth",)).world.camera
    right, _, back = np.array(start.axes()).T
    eye = np.array(start.position)
    camera = ts.Camera(
        _point(eye),
        vertical_fov=start.vertical_fov,
        name="Moves",
        dynamic=ts.LookAt(_point(eye - 3.0 * back), ts.Orbit(_point(eye + 0.3 * right), period=8)),
    )
    objects = []
    for place, template in enumerate(TEMPLATES):
        at = eye - 2.0 * back + 0.5 * (place - 1) * right
        path = ts.Orbit(_point(at + np.array((0.1, 0.0, 0.0))), period=5 + place)
        objects.append(ts.Object(template.lower(), template, position=_point(at), dynamic=path))
    return ts.Scenario(ROOM, objects=tuple(objects), camera=camera)


def _point(position: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = position.tolist()
    return x, y, z
