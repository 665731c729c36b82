# SPDX-License-Identifier: Apache-2.0
"""The package `sailenv` as its scripts import it, made of what is here."""

from __future__ import annotations

import sys
from types import ModuleType

from tiscene.sailenv import agent, manager, scenario_classes, utilities

# Module by module, what it defines and where that is. `sailenv` itself also has its parts as attributes.
CONTENTS: dict[str, tuple[ModuleType, tuple[str, ...]]] = {
    "sailenv": (scenario_classes, ("Vector3",)),
    "sailenv.agent": (agent, ("Agent", "FrameFlags")),
    "sailenv.dynamics": (scenario_classes, ("Dynamic",)),
    "sailenv.dynamics.uniform_movement_random_bounce": (scenario_classes, ("UniformMovementRandomBounce",)),
    "sailenv.dynamics.waypoints": (
        scenario_classes,
        ("CatmullWaypoints", "Dynamic", "LinearWaypoints", "Waypoint", "WaypointsDynamic"),
    ),
    "sailenv.generators": (scenario_classes, ()),
    "sailenv.generators.object": (scenario_classes, ("Object",)),
    "sailenv.generators.scenario": (
        scenario_classes,
        ("AllTogetherTimings", "Frustum", "Object", "Scenario", "Timings"),
    ),
    "sailenv.generators.timings": (
        scenario_classes,
        ("AllTogetherTimings", "DictTimings", "Timings", "WaitUntilCompleteTimings"),
    ),
    "sailenv.manager": (manager, ("SAILenvException", "SAILenvManager")),
    "sailenv.utilities": (utilities, ("draw_flow_map",)),
}


def install(agent_class: type[agent.Agent] = agent.Agent) -> None:
    """Let `import sailenv...` find these. agent_class: what scripts get as Agent."""
    for name, (home, contents) in CONTENTS.items():
        module = ModuleType(name, f"{name} on tiscene")
        module.__path__ = []  # packages too, so that what they do not have is said to be missing, not to be no package
        for content in contents:
            setattr(module, content, getattr(home, content))
        for shared in ("BaseDataclass", "Vector3"):
            setattr(module, shared, getattr(scenario_classes, shared))
        sys.modules[name] = module
        parent, _, own = name.rpartition(".")
        if parent:
            setattr(sys.modules[parent], own, module)
    sys.modules["sailenv.agent"].Agent = agent_class  # type: ignore[attr-defined]
