# SPDX-License-Identifier: Apache-2.0
"""SAILenv's Python API and network protocol, implemented on tiscene.

::

    from tiscene.sailenv import Agent, CatmullWaypoints, Object, Scenario, Vector3, Waypoint

`Agent` works in process, without a server. `tiscene serve` serves unmodified SAILenv clients.
`python -m tiscene.sailenv SCRIPT` runs a script that imports `sailenv`. docs/sailenv.md lists the differences.

::

    agent, agent_objects, agent_lights  Agent
    scenario_classes    Scenario, Object, waypoints, timings
    manager             SAILenvManager
    utilities           draw_flow_map
    downloader          download_executable, download_source: nothing to download
    module_aliases      `import sailenv`
    script_runner       run scripts and scenarios in this process
    captured_scenario   scripts as scenarios of tiscene
    server, connection  TCP server
    wire_format         bytes of the protocol
    agent_worlds        the worlds that agents are in
    environment, environment_edits  one world: its scene and its frame clock, which agents share
    scene_session       the running scene: stream, profile, lights
    agent_camera        state of one agent
    agent_renderer      rendering of agents' views
    agent_walls         walls at the sides of an agent's view
    frame_views         views of a frame in SAILenv's types
    scene_profile       start pose and camera track
    pixel_queries       answers about single pixels within a budget, an extension
    recorded_classes    classes of recordings
    category_numbers    numbers in category views
    light_controls      lights by SAILenv's names
    uploaded_models     models sent by agents
    json_messages       SAILenv's JSON to scenarios
    asset_names         names of scenes and templates
    unity_coordinates   left-handed coordinates; the only module that knows them
"""

from __future__ import annotations

from typing import Any

from dynamics.lazy_names import import_name

_MODULES = {
    "Agent": "tiscene.sailenv.agent",
    "AllTogetherTimings": "tiscene.sailenv.scenario_classes",
    "CatmullWaypoints": "tiscene.sailenv.scenario_classes",
    "CommandsBytes": "tiscene.sailenv.wire_format",
    "DictTimings": "tiscene.sailenv.scenario_classes",
    "Dynamic": "tiscene.sailenv.scenario_classes",
    "FrameFlags": "tiscene.sailenv.agent",
    "Frustum": "tiscene.sailenv.scenario_classes",
    "LinearWaypoints": "tiscene.sailenv.scenario_classes",
    "Object": "tiscene.sailenv.scenario_classes",
    "SAILenvException": "tiscene.sailenv.manager",
    "SAILenvManager": "tiscene.sailenv.manager",
    "Scenario": "tiscene.sailenv.scenario_classes",
    "Timings": "tiscene.sailenv.scenario_classes",
    "UniformMovementRandomBounce": "tiscene.sailenv.scenario_classes",
    "Vector3": "tiscene.sailenv.scenario_classes",
    "WaitUntilCompleteTimings": "tiscene.sailenv.scenario_classes",
    "Waypoint": "tiscene.sailenv.scenario_classes",
    "download_executable": "tiscene.sailenv.downloader",
    "download_source": "tiscene.sailenv.downloader",
    "draw_flow_map": "tiscene.sailenv.utilities",
    "executables_per_platform": "tiscene.sailenv.manager",
}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    return import_name(__name__, _MODULES, name)


def __dir__() -> list[str]:
    return __all__
