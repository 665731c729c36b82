# SPDX-License-Identifier: Apache-2.0
"""What SAILenv's agents need to know about a scene: start pose and camera track.

SAILenv's camera track is a path that an agent can follow (`toggle_follow`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from dynamics import Body, CatmullWaypoints, Dynamic, Simulation, Waypoint
from dynamics.clocks import exact
from tiscene.sailenv import frame_views
from tiscene.sailenv.light_controls import Color8
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera, Quaternion, Vector3
from tiscene.scene.description import SceneDescription
from tiscene.scene.room_volume import RoomVolume, rooms_at

AGENT_CAMERA = "Agent"
TRACK_SPEED = 0.5  # m/s
MIN_WAYPOINT_DISTANCE = 0.05  # m; cameras closer than this to the one before add no waypoint
CIRCLE_RADIUS = 0.3  # m; of the track about a single camera's position


@dataclass(frozen=True)
class SceneProfile:
    """Start pose and camera track of a scene.

    Attributes:
        scenario: The motion that the author of the stage has defined, seen by `start`.
        start: The camera of an agent that has not moved; its exposure is None until it has been metered.
        track: The camera track, of one body.
        fps: Frames per second.
        background: 8-bit sRGB color of pixels that show no object; None for the sky.
        rooms: Volumes of the scene's rooms.
        cameras: Cameras of the stage.
    """

    scenario: Scenario
    start: Camera
    track: Simulation
    fps: float
    background: Color8 | None = None
    rooms: tuple[RoomVolume, ...] = ()
    cameras: tuple[Camera, ...] = ()

    @classmethod
    def of(
        cls, authored: Scenario, stage: SceneDescription, fps: float, background: Color8 | None = None
    ) -> SceneProfile:
        """Return the profile of a scene.

        Args:
            authored: The motion that the author of the stage has defined.
            stage: The stage.
            fps: Frames per second.
            background: 8-bit sRGB color of pixels that show no object; None for the sky.
        """
        start = replace(start_camera(stage), vertical_fov=Camera.vertical_fov, aspect=None, lens=None)
        start = replace(start, far=frame_views.FAR, lens_radius=0.0)
        camera = authored.camera if isinstance(authored.camera, Camera) and authored.camera.dynamic else None
        track = camera_track(stage, camera)
        return cls(replace(authored, camera=start), start, track, fps, background, stage.rooms, stage.cameras)

    def room_start(self, room: str) -> Camera:
        """Return the pose at which agents enter a room: of the camera "Agent" that belongs to it, else of another."""
        inside = rooms_at(self.rooms, [camera.position for camera in self.cameras])
        there = [camera for camera, name in zip(self.cameras, inside, strict=True) if name == room]
        # Cameras of a room that was placed on the stage have names such as "kitchen/Cameras/Agent".
        there.sort(key=lambda camera: (camera.name.split("/")[-1] != AGENT_CAMERA, "/" not in camera.name))
        if there:
            return there[0]
        volume = max((each for each in self.rooms if each.name == room), key=lambda each: each.size)
        x, y, z = volume.world_from_box[:3, 3].tolist()
        return self.start.with_pose((x, y, z), self.start.rotation)

    def track_pose(self, frames: int) -> tuple[Vector3, Quaternion]:
        """Return position (m) and rotation on the camera track a number of frames after its start."""
        x, y, z, *rotation = self.track.poses(frames / exact(self.fps))[0].tolist()
        a, b, c, d = rotation
        return (x, y, z), (a, b, c, d)


def camera_track(stage: SceneDescription, authored: Camera | None = None) -> Simulation:
    """Return the camera track: the author's moving camera, else a closed curve through the cameras of the stage."""
    camera = authored or start_camera(stage)
    return Simulation([Body(camera.dynamic or _track(stage), camera.position, camera.rotation)])


def start_camera(stage: SceneDescription) -> Camera:
    """Return the camera named "Agent", else the first of the stage, else one that sees the whole stage."""
    return next((camera for camera in stage.cameras if camera.name == AGENT_CAMERA), None) or stage.camera()


def _track(stage: SceneDescription) -> Dynamic:
    """Return a closed curve through all cameras of the stage; for a single camera a circle (`_circle`)."""
    waypoints: list[Waypoint] = []
    for camera in stage.cameras:
        if not waypoints or math.dist(waypoints[-1].position, camera.position) > MIN_WAYPOINT_DISTANCE:
            waypoints.append(Waypoint(camera.position, camera.rotation))
    if len(waypoints) < 2:
        waypoints = _circle(start_camera(stage), stage.up)
    length = sum(
        math.dist(here.position, there.position)
        for here, there in zip(waypoints, waypoints[1:] + waypoints[:1], strict=True)
    )
    return CatmullWaypoints(waypoints, total_time=length / TRACK_SPEED, pacing="arc_length")


def _circle(camera: Camera, up: Vector3) -> list[Waypoint]:
    """Return a small circle through the camera's position, all poses of which look at the camera's point of focus."""
    right, camera_up, backward = camera.axes().T
    if abs(backward @ up) > 0.9:  # it looks up or down
        up = tuple(camera_up.tolist())
    target = camera.position - backward * camera.focus_distance
    waypoints = []
    for step in range(8):
        angle = 2.0 * math.pi * step / 8
        x, y, z = (
            camera.position
            + right * (CIRCLE_RADIUS * math.sin(angle))
            + backward * (CIRCLE_RADIUS - CIRCLE_RADIUS * math.cos(angle))
        ).tolist()
        turned = Camera.look_at((x, y, z), tuple(target.tolist()), up)
        waypoints.append(Waypoint(turned.position, turned.rotation))
    return waypoints
