# SPDX-License-Identifier: Apache-2.0
"""How bodies move: parameters in, poses out, the same bytes every time. Needs numpy and Taichi, nothing else.

Trajectories and timings are plain frozen data; a `Simulation` turns them into poses::

    import taichi as ti
    import dynamics

    ti.init(arch=ti.cpu, fast_math=False)
    corners = [dynamics.Waypoint((0, 1, 0)), dynamics.Waypoint((2, 1, 0), (0, 90, 0)), dynamics.Waypoint((1, 2, 2))]
    loop = dynamics.CatmullWaypoints(corners, total_time=6.0)
    simulation = dynamics.Simulation([dynamics.Body(loop)], dynamics.AllTogether(wait_time=0.5))
    poses = simulation.poses(2.25)  # float64 [1, 7]: position in meters, unit quaternion (w, x, y, z)

Bodies that collide, with triangles that stand still, with each other and with walls, are stepped instead, frame by
frame: a `SteppedSimulation` of `Mover`s.

::

    dynamic               interface of trajectories
    waypoints             linear and Catmull-Rom paths
    closed_form           Still, Orbit, LookAt, Keyframes, Composite
    random_bounce         UniformMovementRandomBounce
    stepped_dynamic       Stepped: trajectories written in Python
    quadrature            arc length of cubics
    timings, clocks       when each body moves
    bodies                bodies and their device columns
    simulation            poses of bodies that meet nothing
    path_poses, trajectory_kernel
    colliding_bodies      bodies that collide, and their contacts
    stepped_simulation    collisions, one frame after another
    step_arrays           its device arrays
    step_kernel           its kernel: one substep
    body_layout, body_access
    integrate, path_following, bounce_response
    sweep_obstacles, sweep_bodies
    collision_free        paths on which no collision is possible
    obstacles             triangles that do not move
    tree_access, contact  sphere queries
    sphere_proxy          surfaces covered by spheres
    sphere_cover_kernels  its kernels
    rotation, random      quaternions; counter-based random numbers
    argument_checks       validation of arguments
    kernel_types          types of kernel arguments

Whoever uses the package alone starts Taichi, as above. Meters, seconds, radians; Euler angles, where a class accepts
them, are degrees (see `dynamics.rotation`). Right-handed axes.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from dynamics.bodies import Body
from dynamics.closed_form import Composite, Keyframes, LookAt, Orbit, Still
from dynamics.colliding_bodies import CollisionState, Contact, Mover, Teleport
from dynamics.dynamic import ClosedForm, Dynamic
from dynamics.random_bounce import UniformMovementRandomBounce
from dynamics.sphere_proxy import Shape, cover
from dynamics.stepped_dynamic import Stepped
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
    from dynamics.obstacles import Obstacles
    from dynamics.simulation import Simulation
    from dynamics.stepped_simulation import SteppedSimulation

__all__ = [
    "AllTogether",
    "AllTogetherTimings",
    "Body",
    "CatmullWaypoints",
    "ClosedForm",
    "CollisionState",
    "Composite",
    "Contact",
    "DictTimings",
    "Dynamic",
    "Keyframes",
    "LinearWaypoints",
    "LookAt",
    "Mover",
    "Obstacles",
    "Orbit",
    "Shape",
    "Simulation",
    "Stepped",
    "SteppedSimulation",
    "Still",
    "Teleport",
    "Timing",
    "UniformMovementRandomBounce",
    "WaitUntilComplete",
    "WaitUntilCompleteTimings",
    "Waypoint",
    "cover",
]

# What needs Taichi, whose import takes a moment, is imported at first use.
_LAZY = {
    "Obstacles": "dynamics.obstacles",
    "Simulation": "dynamics.simulation",
    "SteppedSimulation": "dynamics.stepped_simulation",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'dynamics' has no attribute {name!r}")
    return getattr(importlib.import_module(_LAZY[name]), name)
