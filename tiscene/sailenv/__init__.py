# SPDX-License-Identifier: Apache-2.0
"""SAILenv's Python API and network protocol, implemented on tiscene.

::

    from tiscene.sailenv import Agent, CatmullWaypoints, Object, Scenario, Vector3, Waypoint

`Agent` works in process, without a server. `tiscene serve` serves unmodified SAILenv clients.
`python -m tiscene.sailenv SCRIPT` runs a script that imports `sailenv`. docs/sailenv.md lists the differences.

::

    agent, agent_objects, agent_lights, agent_base  Agent
    scenario_classes    Scenario, Object, waypoints, timings
    manager             SAILenvManager
    utilities           draw_flow_map
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

from dynamics.lazy_names import lazy_names

_MODULES = {
    "tiscene.sailenv.agent": ("Agent", "FrameFlags"),
    "tiscene.sailenv.manager": (
        *("SAILenvException", "SAILenvManager", "download_executable", "download_source", "executables_per_platform"),
    ),
    "tiscene.sailenv.scenario_classes": (
        *("AllTogetherTimings", "CatmullWaypoints", "DictTimings", "Dynamic", "Frustum", "LinearWaypoints", "Object"),
        *("Scenario", "Timings", "UniformMovementRandomBounce", "Vector3", "WaitUntilCompleteTimings", "Waypoint"),
    ),
    "tiscene.sailenv.utilities": ("draw_flow_map",),
    "tiscene.sailenv.wire_format": ("CommandsBytes",),
}
__getattr__, __dir__, __all__ = lazy_names(__name__, _MODULES)
