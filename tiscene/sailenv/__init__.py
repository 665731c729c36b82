"""SAILenv on tiscene: its Agent and scenario classes in process, its protocol by `tiscene serve`.

::

    from tiscene.sailenv import Agent, CatmullWaypoints, Object, Scenario, Vector3, Waypoint

`python -m tiscene.sailenv SCRIPT` runs a script that imports `sailenv`. docs/sailenv.md says what is the same, what is
better, and what differs.

::

    agent, scenario, utilities, manager    SAILenv's classes
        modules                            by its module names
    server, connection, wire               its protocol
    environment                            the world that both show
        viewer, views, place               an agent in it, what it sees, where it begins
        lights, uploads                    what agents may change and bring
        description, names, space          SAILenv's JSON, names and axes in tiscene's
"""

from __future__ import annotations

import importlib
from typing import Any

_HOME = {
    "Agent": "agent",
    "AllTogetherTimings": "scenario",
    "CatmullWaypoints": "scenario",
    "DictTimings": "scenario",
    "Dynamic": "scenario",
    "FrameFlags": "agent",
    "Frustum": "scenario",
    "LinearWaypoints": "scenario",
    "Object": "scenario",
    "Scenario": "scenario",
    "Timings": "scenario",
    "UniformMovementRandomBounce": "scenario",
    "Vector3": "scenario",
    "WaitUntilCompleteTimings": "scenario",
    "Waypoint": "scenario",
}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
