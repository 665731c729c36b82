# SPDX-License-Identifier: Apache-2.0
"""One agent in an environment: its pose and camera, image size, background, and place on the frame clock."""

from __future__ import annotations

from dataclasses import dataclass, field

from tiscene.errors import ArgumentError
from tiscene.sailenv.json_messages import bounded
from tiscene.sailenv.light_controls import Color8
from tiscene.sailenv.scene_profile import SceneProfile
from tiscene.sailenv.unity_coordinates import euler_of, mirrored, quaternion_of
from tiscene.scene.camera import Camera, Vector3
from tiscene.scene.walking import Axes, walked_axes

MAX_SIDE, MAX_PIXELS = 8192, 3840 * 2160


@dataclass(frozen=True)
class FlowStep:
    """An agent's camera in a frame, and in an earlier one from which flow is measured.

    Attributes:
        current: The camera in the frame.
        previous: The camera in the earlier frame.
        since: The index of the earlier frame; None for the frame before.
    """

    current: Camera
    previous: Camera
    since: int | None = None


@dataclass(eq=False)
class AgentCamera:
    """The camera of an agent and its state in an environment.

    Attributes:
        id: The agent's number among all of its `AgentWorlds`.
        width: Image width, px.
        height: Image height, px.
        position: In Unity's space, m.
        rotation: Unity's Euler angles, degrees.
        has_own_pose: Whether the agent was moved away from the start pose of the scene.
        background: 8-bit sRGB color of pixels that show no object; None for the scene's own.
        track_start: The frame at which the agent joined the camera track; None if it does not follow the track.
        last_frame: The last frame that the agent has received; -1 for none.
        edit_frame: The frame from which on its last edit of the world shows; -1 for none.
        is_stepping: Whether the agent requests frames, so that the clock waits for it.
        last_camera: The camera of its last frame; None before the first.
        frame_cameras: Its cameras when the current frame and the one before began, by frame, if it was there.
        walks: World axes along which it has walked in this scene.
        queries: The number of its questions about pixels that were answered.

    Raises:
        ArgumentError: The image is too large or empty.
    """

    id: int
    width: int
    height: int
    position: Vector3 = (0.0, 0.0, 0.0)
    rotation: Vector3 = (0.0, 0.0, 0.0)
    has_own_pose: bool = False
    background: Color8 | None = None
    track_start: int | None = None
    last_frame: int = -1
    edit_frame: int = -1
    is_stepping: bool = False
    last_camera: Camera | None = None
    frame_cameras: dict[int, Camera] = field(default_factory=dict)
    walks: Axes = Axes()  # noqa: RUF009  # immutable
    queries: int = 0

    def __post_init__(self) -> None:
        width, height = self.width, self.height
        if not (0 < width <= MAX_SIDE and 0 < height <= MAX_SIDE and width * height <= MAX_PIXELS):
            raise ArgumentError(
                f"{width}x{height} px: a side must be from 1 to {MAX_SIDE}, all pixels at most {MAX_PIXELS}"
            )

    def needs_new_frame(self, clock: int) -> bool:
        """Return whether the agent's next frame is later than the current one, whose index is `clock`."""
        return clock < 0 or clock < self.edit_frame or self.last_frame == clock

    def restart_clock(self) -> None:
        """Forget all frames, for a new scene; an agent on the camera track starts it again."""
        self.last_frame = self.edit_frame = -1
        self.last_camera, self.frame_cameras = None, {}
        self.walks = Axes()
        self.track_start = None if self.track_start is None else 0

    def begin_frame(self, profile: SceneProfile, frame: int) -> None:
        """Record the camera at a new frame, whether the agent receives it or not. May be repeated."""
        before, now = self.frame_cameras.get(frame - 1), self.camera(profile, frame)
        if before is not None:
            self.walks |= walked_axes(before.position, now.position)
        self.frame_cameras = {frame: now} if before is None else {frame - 1: before, frame: now}

    def flow_step(self, profile: SceneProfile, clock: int, consecutive: bool) -> FlowStep:
        """Return the cameras between which flow in frame `clock` is measured.

        Args:
            profile: The profile of the scene.
            clock: The current frame.
            consecutive: Whether flow is measured from the frame before instead of the agent's last frame.
        """
        camera = self.camera(profile, clock)
        if self.last_camera is None:
            return FlowStep(camera, camera)
        if consecutive and self.last_frame < clock - 1:
            return FlowStep(camera, self.frame_cameras.get(clock - 1, camera))
        return FlowStep(camera, self.last_camera, self.last_frame if self.last_frame < clock - 1 else None)

    def reset(self, profile: SceneProfile) -> None:
        """Move to the start pose of a scene."""
        self.position, self.rotation = mirrored(profile.start.position), euler_of(profile.start.rotation)
        self.has_own_pose, self.track_start = False, None

    def walk_to(self, camera: Camera) -> None:
        """Move to the pose of a camera in tiscene's space, without flow from the pose before."""
        self.position, self.rotation = mirrored(camera.position), euler_of(camera.rotation)
        self.has_own_pose, self.track_start = True, None
        self.last_camera, self.frame_cameras = None, {}

    def camera(self, profile: SceneProfile, frame: int) -> Camera:
        """Return the camera at a frame, in tiscene's space."""
        if self.track_start is None:
            return profile.start.with_pose(mirrored(self.position), quaternion_of(self.rotation))
        return profile.start.with_pose(*profile.track_pose(frame - self.track_start))

    def pose(self, profile: SceneProfile, frame: int) -> tuple[Vector3, Vector3]:
        """Return position (m) and Euler angles (degrees) at a frame: as they were set, or those of the camera track."""
        if self.track_start is None:
            return self.position, self.rotation
        camera = self.camera(profile, max(frame, self.track_start))
        return mirrored(camera.position), euler_of(camera.rotation)

    def set_pose(self, profile: SceneProfile, frame: int, position: Vector3 | None, rotation: Vector3 | None) -> None:
        """Leave the camera track, and set position (m) and Euler angles (degrees); None leaves either as it is."""
        old_position, old_rotation = self.pose(profile, frame)
        self.position = old_position if position is None else bounded(position)
        self.rotation = old_rotation if rotation is None else bounded(rotation)
        self.has_own_pose, self.track_start = True, None

    def toggle_follow(self, profile: SceneProfile, frame: int) -> None:
        """Join the camera track at its start after a frame, or leave it and stay at the pose of that frame."""
        if self.track_start is None:
            self.track_start = frame + 1
        else:
            self.position, self.rotation = self.pose(profile, frame)
            self.track_start, self.has_own_pose = None, True
