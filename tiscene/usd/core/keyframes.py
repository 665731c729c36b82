# SPDX-License-Identifier: Apache-2.0
"""What moves or comes and goes on a stage by time samples, as keyframes and life spans."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from tiscene.usd.core.pose import read_pose
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.time_samples import filled
from tiscene.usd.core.units import Units

MOST_TIMES = 100_000  # time codes at which a thing or a light that changes is looked at
_TURNS = {
    getattr(UsdGeom.XformOp, f"TypeRotate{axes}") for axes in ("X", "Y", "Z", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
}


def sample_times(prim: Usd.Prim) -> list[float]:
    """The time codes at which the place of a prim in the world is authored; fewer than two if it stands still.

    Angles that USD interpolates are sampled at every time code between, since keyframes turn the shortest way.
    """
    times: set[float] = set()
    angles = False
    while prim and not prim.IsPseudoRoot():
        xformable = UsdGeom.Xformable(prim)
        if xformable:
            for op in xformable.GetOrderedXformOps():
                samples = op.GetTimeSamples()
                times.update(samples)
                angles = angles or (len(samples) > 1 and op.GetOpType() in _TURNS)
            if xformable.GetResetXformStack():
                break
        prim = prim.GetParent()
    return filled(times, MOST_TIMES) if angles else sorted(times)


def read_life(prim: Usd.Prim, report: StageReport) -> tuple[int, int | None] | None:
    """First and last frame of a prim whose own visibility is animated, None for no last; None if it is always there.

    Frames are time codes, counted from the start of the stage's range: as when it is played at its own rate.
    """
    visibility = UsdGeom.Imageable(prim).GetVisibilityAttr()
    if not visibility or visibility.GetNumTimeSamples() < 2:
        return None
    start = prim.GetStage().GetStartTimeCode()
    shown = [(time, visibility.Get(time) != UsdGeom.Tokens.invisible) for time in visibility.GetTimeSamples()]
    changes = [each for row, each in enumerate(shown) if row == 0 or each[1] != shown[row - 1][1]]
    begins = [time for time, visible in changes if visible]
    if not begins or len(changes) < 2:
        return None
    if len(begins) > 1:
        report.omission(prim.GetPath(), "what is hidden and shown again is shown from its first to its last time")
    first = 0 if changes[0][1] else max(0, math.ceil(begins[0] - start))
    last = None if changes[-1][1] else math.ceil(changes[-1][0] - start) - 1
    return None if last is not None and last < first else (first, last)


def read_keyframes(prim: Usd.Prim, units: Units, report: StageReport, first_frame: int = 0) -> dict[str, Any] | None:
    """A prim's animated transform as the JSON object of Keyframes; None if it stands still.

    Time 0 is the start of the stage's range of time codes, or so many frames later when the prim appears. What is
    reported: a scale that changes, of which the first is kept, and a prim that cannot be placed at some time and
    stands still therefore.
    """
    times = sample_times(prim)
    if len(times) < 2:
        return None
    start = prim.GetStage().GetStartTimeCode() + first_frame
    times = sorted({max(time, start) for time in times})
    rate = prim.GetStage().GetTimeCodesPerSecond()
    waypoints, stretches = [], []
    for time in times:
        pose = read_pose(prim, Usd.TimeCode(time), units)
        if isinstance(pose, str):
            report.omission(prim.GetPath(), f"{pose} at time code {time:g}, so that the prim stands still")
            return None
        waypoints.append({"position": list(pose.position), "rotation": list(pose.rotation)})
        stretches.append(np.diag([*pose.scale, 1.0]) @ pose.stretch)
    if any(not np.allclose(stretch, stretches[0], atol=1e-5) for stretch in stretches):
        report.omission(prim.GetPath(), "an animated scale keeps its first value")
    if all(each == waypoints[0] for each in waypoints):
        return None
    seconds = [(time - start) / rate for time in times]
    return {"type": "Keyframes", "times": seconds, "waypoints": waypoints, "repeat": False}
