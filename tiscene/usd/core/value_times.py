# SPDX-License-Identifier: Apache-2.0
"""The time codes between which the values of attributes are linear: time samples, value blocks and splines.

Whatever plays an attribute reads it at `value_times` and interpolates between them. A jump has two of them, as near as
USD can tell apart: one for the value that is held until then, one for the new value.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

from pxr import Usd, UsdGeom

MAX_TIMES = 10_000  # longest range, in steps, that is sampled at every step
_RATE = 24.0  # steps a second, at least nearly: USD's default of timeCodesPerSecond
JUMP = Usd.TimeCode.SafeStep()  # from the last time before a jump to the jump


def value_times(attribute: Usd.Attribute) -> list[float]:
    """Return the time codes between which an attribute's value is linear, ascending; empty without animation.

    A spline has its knots and every step between its knots and those of the stage's range. USD does not interpolate to
    or from a blocked sample: the value before is held until then, and there is none until the next sample.
    """
    times = attribute.GetTimeSamples() if attribute else []
    if len(times) > 1:
        blocked = [attribute.Get(time) is None for time in times]
        jumps = [times[row + 1] for row, (a, b) in enumerate(pairwise(blocked)) if a != b]
    elif has_spline(attribute):
        spline, stage = attribute.GetSpline(), attribute.GetStage()
        knots = [knot.GetTime() for knot in spline.GetKnots().values()]
        jumps = [time for time in knots if spline.EvalPreValue(time) != spline.Eval(time)]
        times = dense_times((*knots, stage.GetStartTimeCode(), stage.GetEndTimeCode()), stage)
    else:
        return list(times)
    return sorted({*times, *(time - JUMP for time in jumps)})


def value_at(attribute: Usd.Attribute, time: Usd.TimeCode) -> Any:
    """Return an attribute's value, or its schema's fallback where a time sample is blocked; None if it has neither."""
    value = attribute.Get(time)
    if value is None:
        value = attribute.GetPrim().GetPrimDefinition().GetAttributeFallbackValue(attribute.GetName())
    return value


def time_code_number(prim: Usd.Prim, time: Usd.TimeCode) -> float:
    """Return a time code as a number: the earliest one is the start of the prim's stage."""
    return float(prim.GetStage().GetStartTimeCode() if time.IsEarliestTime() else time.GetValue())


def has_spline(attribute: Usd.Attribute) -> bool:
    """Return whether an attribute's value comes from a spline."""
    return bool(attribute) and attribute.HasSpline()


def transform_times(xformable: UsdGeom.Xformable) -> list[float]:
    """Return the `value_times` of a prim's transform operations, ascending."""
    return sorted({time for op in xformable.GetOrderedXformOps() for time in value_times(op.GetAttr())})


def is_time_varying(attribute: Usd.Attribute) -> bool:
    """Return whether an attribute has different values at different times; many exporters sample constant values."""
    times = value_times(attribute)
    if len(times) < 2:
        return False
    first = attribute.Get(times[0])
    return any(attribute.Get(time) != first for time in times[1:])


def steps_per_time_code(stage: Usd.Stage) -> int:
    """Return how many steps a time code has: one, or more where it is longer than a frame, as where it is a second."""
    rate = stage.GetTimeCodesPerSecond()
    return max(1, round(min(_RATE / rate, float(MAX_TIMES)))) if rate > 0.0 else 1


def dense_times(times: Iterable[float], stage: Usd.Stage, max_range: float = MAX_TIMES) -> list[float]:
    """Return time codes and all steps between them, ascending: the whole time codes, of slow stages parts of them too.

    Instances are interpolated linearly between samples. USD interpolates operations, angles above all, so that samples
    at every frame keep the result close.

    Args:
        times: the authored time codes.
        stage: gives the time code rate.
        max_range: over a longer range, in steps, the authored ones alone are returned.
    """
    dense, steps = set(times), steps_per_time_code(stage)
    if len(dense) > 1 and (max(dense) - min(dense)) * steps <= max_range:
        dense.update(step / steps for step in range(math.ceil(min(dense) * steps), math.floor(max(dense) * steps) + 1))
    return sorted(dense)
