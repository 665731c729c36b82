# SPDX-License-Identifier: Apache-2.0
"""The package `sailenv` as scripts import it, made of the classes of `tiscene.sailenv`.

`install` puts the modules of CONTENTS into `sys.modules`.
"""

from __future__ import annotations

import sys
from types import ModuleType

from tiscene.sailenv import agent, manager, scenario_classes, utilities, wire_format

# For each module of SAILenv, the module here that defines its names, and the names.
CONTENTS: dict[str, tuple[ModuleType, tuple[str, ...]]] = {
    "sailenv": (scenario_classes, ("Vector3",)),
    "sailenv.agent": (agent, ("Agent", "FrameFlags")),
    "sailenv.downloader": (manager, ("download_executable", "download_source", "os_name", "os_names")),
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
    "sailenv.manager": (manager, ("SAILenvException", "SAILenvManager", "executables_per_platform")),
    "sailenv.utilities": (utilities, ("draw_flow_map",)),
}


def install(agent_class: type[agent.Agent] = agent.Agent) -> None:
    """Make `import sailenv` and its submodules import these classes.

    Args:
        agent_class: The class that scripts import as `Agent`.
    """
    for name, (source, contents) in CONTENTS.items():
        module = ModuleType(name, f"{name} on tiscene")
        module.__path__ = []  # makes it a package, so that importing a missing submodule gives the usual error
        for content in contents:
            setattr(module, content, getattr(source, content))
        for shared in ("BaseDataclass", "Vector3"):
            setattr(module, shared, getattr(scenario_classes, shared))
        sys.modules[name] = module
        parent, _, own = name.rpartition(".")
        if parent:
            setattr(sys.modules[parent], own, module)
    sys.modules["sailenv.agent"].CommandsBytes = wire_format.CommandsBytes  # type: ignore[attr-defined]
    sys.modules["sailenv.agent"].Agent = agent_class  # type: ignore[attr-defined]
