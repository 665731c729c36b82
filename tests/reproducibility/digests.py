# SPDX-License-Identifier: Apache-2.0
"""Digests of a few small frames of shipped scenes: one per preset, with every kind of motion."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import tiscene as ts
from tiscene.frame.buffers import BUFFERS

EXPECTED = Path(__file__).parent / "digests.json"
SIZE = {"width": 32, "height": 24}
# Denoised color repeats on one machine only.
LABELS_AND_HDR = tuple(name for name in BUFFERS if name not in ("rgb", "denoised"))


def scenarios() -> dict[str, tuple[ts.Scenario, dict[str, object], int]]:
    """Return by name a scenario, arguments of its stream and a frame index."""
    loop = ts.CatmullWaypoints(
        [ts.Waypoint((-0.4, 0.6, 0.0)), ts.Waypoint((0.4, 0.9, 0.2), (0, 90, 0)), ts.Waypoint((0.0, 0.7, -0.4))],
        total_time=3.0,
    )
    objects = [
        ts.Object("chair", "Chair 01", dynamic=loop, scale=0.4),
        ts.Object("ball", "Ball 01", (0.0, 1.0, 0.6), dynamic=ts.UniformMovementRandomBounce(speed=1.0, seed=3)),
    ]
    moving = ts.Scenario("solid_benchmark", objects)
    turning = ts.Camera((0.0, 1.2, 0.5), dynamic=ts.LookAt((0.0, 0.8, -1.5), ts.Orbit((0.0, 1.2, -1.0), period=8.0)))
    return {
        "movers, standard": (moving, {"quality": "standard", "spp": 4}, 7),
        "movers, fast": (moving, {"quality": "fast", "base_spp": 4}, 7),
        "movers, preview": (moving, {"quality": "preview", "base_spp": 4}, 7),
        "moving camera, photo": (ts.Scenario("solid_benchmark", camera=turning), {"quality": "photo", "spp": 4}, 9),
        "textures": (ts.Scenario("object_view", objects[:1]), {"quality": "standard", "spp": 4}, 3),
    }


def digests() -> dict[str, dict[str, str]]:
    """Render the frames and return the digests of their buffers."""
    result = {}
    for name, (scenario, settings, index) in scenarios().items():
        with ts.Stream(scenario, **SIZE, buffers=LABELS_AND_HDR, **settings) as stream:  # type: ignore[arg-type]
            frame = stream[index]
            result[name] = {each: hashlib.sha256(frame[each].tobytes()).hexdigest()[:16] for each in LABELS_AND_HDR}
    return result


def differences(expected: dict[str, dict[str, str]], found: dict[str, dict[str, str]]) -> list[str]:
    """Return "scenario: buffer" for every digest that differs."""
    return [
        f"{name}: {buffer}"
        for name, buffers in found.items()
        for buffer, digest in buffers.items()
        if expected.get(name, {}).get(buffer) != digest
    ]


def load() -> dict[str, dict[str, str]]:
    """Return the digests kept in the repository."""
    content: dict[str, dict[str, str]] = json.loads(EXPECTED.read_text(encoding="utf-8"))
    return content
