# SPDX-License-Identifier: Apache-2.0
"""Animated objects of a stage as scenario data: transforms as keyframes, visibility of listed ones as a lifespan.

Transforms of whole objects and of cameras play through the scenario, as if a user had given them a `Keyframes`
trajectory. All other animation of objects is read by `time_samples` instead.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from tiscene.usd.core.pose import read_pose
from tiscene.usd.core.prims import ALSO_ABSTRACT, is_light_only, prototypes_of, with_ancestors
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.transform import to_matrix
from tiscene.usd.core.units import Units
from tiscene.usd.core.value_times import dense_times, value_times

MAX_TIMES = 100_000  # longest range, in steps, that is sampled at every step
_ROTATIONS = {UsdGeom.XformOp.TypeOrient} | {
    getattr(UsdGeom.XformOp, f"TypeRotate{axes}") for axes in ("X", "Y", "Z", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")
}
_RIGID = {UsdGeom.XformOp.TypeTranslate} | _ROTATIONS


def sample_times(prim: Usd.Prim) -> list[float]:
    """Return the time codes at which a prim's world transform is authored, ascending; fewer than two if it is static.

    Animated rotations are sampled at every step between: USD interpolates the angles, while keyframes rotate
    the shortest way, and what turns about another point than its own moves along an arc.
    """
    times: set[float] = set()
    turns = False
    for xformable in filter(None, map(UsdGeom.Xformable, with_ancestors(prim))):
        for op in xformable.GetOrderedXformOps():
            samples = value_times(op.GetAttr())
            times.update(samples)
            turns = turns or (len(samples) > 1 and op.GetOpType() in _ROTATIONS)
        if xformable.GetResetXformStack():
            break
    return dense_times(times, prim.GetStage(), MAX_TIMES) if turns else sorted(times)


def plays_in_parts(prim: Usd.Prim) -> bool:
    """Return whether a prim's time samples are more than a rigid trajectory of the whole prim.

    Its scale or shear changes, `!resetXformStack!` keeps parts of it in place, points of an instancer in it are objects
    of their own, or it is hidden or shown: lifespans count frames, whose rate is not that of the stage. It is played by
    the transforms and the presence of its parts.
    """
    if len(_visibility_changes(prim)) > 1:
        return True
    times = sample_times(prim)
    if len(times) < 2:
        return False
    inside = list(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
    return (
        changes_scale(prim, times)
        or any(
            each != prim and UsdGeom.Xformable(each).GetResetXformStack()
            for each in inside
            if each.IsA(UsdGeom.Xformable)
        )
        or any(_places_objects(each) for each in inside if each.IsA(UsdGeom.PointInstancer))
    )


def _places_objects(instancer: Usd.Prim) -> bool:
    """Return whether the points of an instancer are objects of their own, without lights, whose places do not play."""
    prototypes = prototypes_of(instancer)
    return bool(prototypes) and not any(
        is_light_only(each) for prim in prototypes for each in Usd.PrimRange(prim, ALSO_ABSTRACT)
    )


def changes_scale(prim: Usd.Prim, times: list[float]) -> bool:
    """Return whether a prim's world transform changes more than its pose at some time codes."""
    if len(times) < 2:
        return False
    lineage = filter(None, map(UsdGeom.Xformable, with_ancestors(prim)))  # what turns below a scale changes too
    if all(op.GetOpType() in _RIGID for each in lineage for op in each.GetOrderedXformOps()):
        return False
    xformable = UsdGeom.Xformable(prim)
    worlds = [to_matrix(xformable.ComputeLocalToWorldTransform(Usd.TimeCode(time)), 1.0)[:3, :3] for time in times]
    products = np.array([world.T @ world for world in worlds])  # the same if only the rotation changes
    return bool((np.abs(products - products[0]) > 1e-5 * max(1e-30, float(np.abs(products).max()))).any())


def _visibility_changes(prim: Usd.Prim) -> list[tuple[float, bool]]:
    """Return the first time code of a prim's own visibility and those at which it changes, each with its new value."""
    visibility = UsdGeom.Imageable(prim).GetVisibilityAttr()
    if not visibility or visibility.GetNumTimeSamples() < 2:
        return []
    samples = [(time, visibility.Get(time) != UsdGeom.Tokens.invisible) for time in visibility.GetTimeSamples()]
    return [each for row, each in enumerate(samples) if row == 0 or each[1] != samples[row - 1][1]]


def read_lifespan(prim: Usd.Prim, report: StageReport) -> tuple[int, int | None] | None:
    """Return the first and last frame at which a prim is visible, from the samples of its own visibility.

    Frames are time codes counted from the start of the stage's range, as `write_motion` writes them.

    Args:
        prim: an imageable prim.
        report: receives an omission for a prim that is hidden and shown again, and that its schema makes an object.

    Returns:
        First frame, and last frame (None: no end). None if its visibility is not animated.
    """
    start, changes = prim.GetStage().GetStartTimeCode(), _visibility_changes(prim)
    shown = [time for time, visible in changes if visible]
    if not shown or len(changes) < 2:
        return None
    if len(shown) > 1:
        report.omission(
            prim.GetPath(), "a prim that is hidden and shown again is shown from its first to its last visible time"
        )
    first = 0 if changes[0][1] else max(0, math.ceil(shown[0] - start))
    last = None if changes[-1][1] else math.ceil(changes[-1][0] - start) - 1
    return None if last is not None and last < first else (first, last)


def read_keyframes(prim: Usd.Prim, units: Units, report: StageReport, first_frame: int = 0) -> dict[str, Any] | None:
    """Return a prim's animated transform as the JSON object of a `Keyframes`; None if it is static.

    Args:
        prim: the prim.
        units: unit of length of its stage.
        report: receives an omission: a prim without a valid pose at some time, which is static then.
        first_frame: frame at which the prim appears. Time 0 of the keyframes is that many time codes after the start of
            the stage's range.
    """
    times = sample_times(prim)
    if len(times) < 2:
        return None
    start = prim.GetStage().GetStartTimeCode() + first_frame
    times = sorted({max(time, start) for time in times})
    rate = prim.GetStage().GetTimeCodesPerSecond()
    waypoints = []
    for time in times:
        pose = read_pose(prim, Usd.TimeCode(time), units)
        if isinstance(pose, str):
            report.omission(prim.GetPath(), f"{pose} at time code {time:g}, so that the prim stands still")
            return None
        waypoints.append({"position": list(pose.position), "rotation": list(pose.rotation)})
    if all(each == waypoints[0] for each in waypoints):
        return None
    seconds = [(time - start) / rate for time in times]
    return {"type": "Keyframes", "times": seconds, "waypoints": waypoints, "repeat": False}
