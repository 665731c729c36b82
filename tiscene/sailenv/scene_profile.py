# SPDX-License-Identifier: Apache-2.0
"""What a scene is to agents: where they begin, the track that they can follow, and the numbers of its categories."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from fractions import Fraction

from dynamics import Body, CatmullWaypoints, Dynamic, Simulation, Waypoint
from tiscene.sailenv import asset_names, frame_views
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera, Quaternion, Vector3
from tiscene.scene.description import SceneDescription
from tiscene.stream.stream import Stream

SPEED = 0.5  # m/s
NEAR = 0.05  # m; stations closer than this to the one before are left out


@dataclass(frozen=True)
class SceneProfile:
    """A scene.

    authored: what its author lets happen, seen from `start`. start: where agents begin, and what they see by.
    track: of the camera, for `toggle_follow`. numbers: of categories; those beyond the last are shown as none.
    """

    authored: Scenario
    start: Camera
    track: CameraTrack
    numbers: dict[str, int] = field(default_factory=lambda: {"": frame_views.NO_CATEGORY})

    @classmethod
    def of(cls, stream: Stream) -> SceneProfile:
        """The scene of a stream that plays it as its author made it. The stream may begin anew by this."""
        authored, stage = stream.scenario, stream.world.stage
        start = replace(_start(stage), vertical_fov=Camera.vertical_fov, far=frame_views.FAR, lens_radius=0.0)
        if start.exposure is None:
            stream.restart(replace(authored, camera=start))
            start = replace(start, exposure=stream.exposure)
        camera = authored.camera if isinstance(authored.camera, Camera) and authored.camera.dynamic else None
        place = cls(replace(authored, camera=start), start, CameraTrack(stage, camera))
        for category in (*(each.category for each in stage.objects), *asset_names.template_categories().values()):
            place.number(category)
        return place

    def number(self, category: str) -> int:
        """The number by which views show a category; a new one gets the next."""
        return self.numbers.setdefault(category, min(len(self.numbers), frame_views.NO_CATEGORY))


class CameraTrack:
    """Where a camera on the track is at a time: on that of the stage's author, else round and round all cameras."""

    def __init__(self, stage: SceneDescription, authored: Camera | None) -> None:
        """authored: a camera with a dynamic, None if the author of the stage made none move."""
        camera = authored or _start(stage)
        self._simulation = Simulation([Body(camera.dynamic or _round(stage), camera.position, camera.rotation)])

    def pose(self, seconds: Fraction) -> tuple[Vector3, Quaternion]:
        """Position, m, and unit quaternion (w, x, y, z) so long after the start."""
        x, y, z, *rotation = self._simulation.poses(seconds)[0].tolist()
        a, b, c, d = rotation
        return (x, y, z), (a, b, c, d)


def _start(stage: SceneDescription) -> Camera:
    """The camera "Agent", else the stage's first, else one that sees the whole stage."""
    return next((camera for camera in stage.cameras if camera.name == "Agent"), None) or stage.camera()


def _round(stage: SceneDescription) -> Dynamic:
    """A closed curve through all cameras of the stage; about the only one's point of focus if there is no other."""
    stations: list[Waypoint] = []
    for camera in stage.cameras:
        if not stations or math.dist(stations[-1].position, camera.position) > NEAR:
            stations.append(Waypoint(camera.position, camera.rotation))
    if len(stations) < 2:
        stations = _circle(_start(stage), stage.up)
    length = sum(
        math.dist(here.position, there.position)
        for here, there in zip(stations, stations[1:] + stations[:1], strict=True)
    )
    return CatmullWaypoints(stations, total_time=length / SPEED, pacing="arc_length")


def _circle(camera: Camera, up: Vector3) -> list[Waypoint]:
    right, own_up, backward = camera.axes().T
    if abs(backward @ up) > 0.9:  # it looks up or down
        up = tuple(own_up.tolist())
    target = camera.position - backward * camera.focus_distance
    stations = []
    for step in range(8):
        angle = 2.0 * math.pi * step / 8
        x, y, z = (
            camera.position + right * (0.3 * math.sin(angle)) + backward * (0.3 - 0.3 * math.cos(angle))
        ).tolist()
        turned = Camera.look_at((x, y, z), tuple(target.tolist()), up)
        stations.append(Waypoint(turned.position, turned.rotation))
    return stations
