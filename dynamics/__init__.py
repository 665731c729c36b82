# SPDX-License-Identifier: Apache-2.0
"""Trajectories, timings and collisions of rigid bodies: parameters in, poses out, the same bytes every time.

The package needs numpy and Taichi only. Trajectories and timings are frozen dataclasses; a `Simulation` evaluates
their poses::

    import taichi as ti
    import dynamics

    ti.init(arch=ti.cpu, fast_math=False)
    corners = [dynamics.Waypoint((0, 1, 0)), dynamics.Waypoint((2, 1, 0), (0, 90, 0)), dynamics.Waypoint((1, 2, 2))]
    loop = dynamics.CatmullWaypoints(corners, total_time=6.0)
    simulation = dynamics.Simulation([dynamics.Body(loop)], dynamics.AllTogether(wait_time=0.5))
    poses = simulation.poses(2.25)  # float64 [1, 7]: position in meters, unit quaternion (w, x, y, z)

Bodies that collide with static triangles, with each other and with planes are simulated frame by frame by a
`SteppedSimulation` of `Mover`s.

Used alone, the package leaves starting Taichi to the caller, as above. Units are meters, seconds and radians; Euler
angles, where a class accepts them, are degrees (see `dynamics.rotation`). Axes are right-handed.

::

    dynamic                             interface of trajectories, and the tracks they are made of
    waypoints                           linear and Catmull-Rom paths
    closed_form                         Still, Orbit, LookAt, Keyframes, Composite
    random_bounce                       UniformMovementRandomBounce
    rigid_body                          RigidBody
    joint_loops                         joints that close loops
    stepped_dynamic                     Stepped: trajectories written in Python
    quadrature                          arc length of cubics
    timings, clocks                     when each body moves; exact time
    bodies                              bodies and their device arrays
    simulation                          poses without collisions
    path_poses, trajectory_kernel       evaluation of paths on the host and in a kernel
    colliding_bodies                    movers, their contacts, their state at a frame
    stepped_simulation                  collisions, frame by frame
    step_arrays, step_kernel            its arrays; one substep
    body_layout, body_access            columns of bodies, and access to them in kernels
    integrate                           choice of each body's next motion
    path_following, bounce_response     collision responses
    sweep_obstacles, sweep_walls        continuous collision detection of static triangles, of walls
    sweep_movers                        and of other movers
    path_cover, collision_free          balls around paths; test for paths without any collision
    obstacles, tree_access              static triangles, and their hierarchy in kernels
    sphere_query, contact               spheres against all obstacles, and against a triangle
    sphere_proxy, sphere_cover_kernels  sphere proxies of surfaces
    surface_overlap                     surfaces that cross; points inside of closed ones
    rotation, random                    quaternions; counter-based random numbers
    errors, argument_checks             exceptions; validation of arguments
    kernel_types, balanced_loops        types of kernel arguments; loops whose work threads share evenly
    lru_cache, weak_cache               caches: of a bounded number of values, of objects that exist
    checkpoints                         states at intervals, in bounded memory
    whole_changes                       methods that an exception may leave half done
    lazy_names                          names of packages that are imported at first use
    cache_folder                        folder of Taichi's cache where there is no home
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from dynamics.cache_folder import set_cache_folder
from dynamics.lazy_names import lazy_names

if TYPE_CHECKING:
    from dynamics.bodies import Body
    from dynamics.closed_form import Composite, Keyframes, LookAt, Orbit, Still
    from dynamics.colliding_bodies import CollisionState, Contact, Mover, Teleport
    from dynamics.dynamic import ClosedForm, Dynamic
    from dynamics.errors import ArgumentError, ArgumentTypeError
    from dynamics.obstacles import Obstacles
    from dynamics.random_bounce import UniformMovementRandomBounce
    from dynamics.rigid_body import RigidBody
    from dynamics.simulation import Simulation
    from dynamics.sphere_proxy import Shape, cover
    from dynamics.stepped_dynamic import Stepped
    from dynamics.stepped_simulation import SteppedSimulation
    from dynamics.timings import (
        AllTogether,
        AllTogetherTimings,
        DictTimings,
        Timing,
        WaitUntilComplete,
        WaitUntilCompleteTimings,
    )
    from dynamics.waypoints import CatmullWaypoints, LinearWaypoints, Waypoint

__all__ = [
    "AllTogether",
    "AllTogetherTimings",
    "ArgumentError",
    "ArgumentTypeError",
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
    "RigidBody",
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

set_cache_folder()

# Module of each public name. Names are imported at first use, so that `import dynamics` loads neither numpy nor Taichi.
_MODULES = {
    "dynamics.bodies": ("Body",),
    "dynamics.closed_form": ("Composite", "Keyframes", "LookAt", "Orbit", "Still"),
    "dynamics.colliding_bodies": ("CollisionState", "Contact", "Mover", "Teleport"),
    "dynamics.dynamic": ("ClosedForm", "Dynamic"),
    "dynamics.errors": ("ArgumentError", "ArgumentTypeError"),
    "dynamics.obstacles": ("Obstacles",),
    "dynamics.random_bounce": ("UniformMovementRandomBounce",),
    "dynamics.rigid_body": ("RigidBody",),
    "dynamics.simulation": ("Simulation",),
    "dynamics.sphere_proxy": ("Shape", "cover"),
    "dynamics.stepped_dynamic": ("Stepped",),
    "dynamics.stepped_simulation": ("SteppedSimulation",),
    "dynamics.timings": (
        *("AllTogether", "AllTogetherTimings", "DictTimings", "Timing", "WaitUntilComplete"),
        "WaitUntilCompleteTimings",
    ),
    "dynamics.waypoints": ("CatmullWaypoints", "LinearWaypoints", "Waypoint"),
}
__getattr__, __dir__, _ = lazy_names(__name__, _MODULES)
