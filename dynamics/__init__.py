"""How bodies move: parameters in, poses out, the same bytes every time. Needs numpy and Taichi, nothing else.

Trajectories and timings are plain frozen data; a `Simulation` turns them into poses::

    import taichi as ti
    import dynamics

    ti.init(arch=ti.cpu, fast_math=False)
    corners = [dynamics.Waypoint((0, 1, 0)), dynamics.Waypoint((2, 1, 0), (0, 90, 0)), dynamics.Waypoint((1, 2, 2))]
    loop = dynamics.CatmullWaypoints(corners, total_time=6.0)
    simulation = dynamics.Simulation([dynamics.Body(loop)], dynamics.AllTogether(wait_time=0.5))
    poses = simulation.poses(2.25)  # float64 [1, 7]: position in metres, unit quaternion (w, x, y, z)

Whoever uses the package alone starts Taichi, as above. Metres, seconds, radians; Euler angles, where a class accepts
them, are degrees (see `dynamics.rotation`). Right-handed axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dynamics.bodies import Body
from dynamics.closed_form import Composite, Keyframes, LookAt, Orbit, Still
from dynamics.dynamic import ClosedForm, Dynamic
from dynamics.timings import (
    AllTogether,
    AllTogetherTimings,
    DictTimings,
    Timing,
    WaitUntilComplete,
    WaitUntilCompleteTimings,
)
from dynamics.waypoints import CatmullWaypoints, LinearWaypoints, Waypoint

if TYPE_CHECKING:
    from dynamics.simulation import Simulation

__all__ = [
    "AllTogether",
    "AllTogetherTimings",
    "Body",
    "CatmullWaypoints",
    "ClosedForm",
    "Composite",
    "DictTimings",
    "Dynamic",
    "Keyframes",
    "LinearWaypoints",
    "LookAt",
    "Orbit",
    "Simulation",
    "Still",
    "Timing",
    "WaitUntilComplete",
    "WaitUntilCompleteTimings",
    "Waypoint",
]


def __getattr__(name: str) -> Any:
    """`Simulation` is imported at first use: it alone needs Taichi, whose import takes a moment."""
    if name != "Simulation":
        raise AttributeError(f"module 'dynamics' has no attribute {name!r}")
    from dynamics.simulation import Simulation

    return Simulation
