# SPDX-License-Identifier: Apache-2.0
"""FrameEvaluator: placements, live objects, lights and movers of a world at one frame, from its edit log.

All are functions of the frame and of the edits up to it. The time they take depends on the number of objects that are
alive around the frame, not on the number of edits.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion
from tiscene.frame.events import Event
from tiscene.frame.object_table import ObjectState
from tiscene.scenario.edits import EditLog
from tiscene.scene.description import Light
from tiscene.scene.lights.light_groups import LightGroups
from tiscene.scene.placement import Placement
from tiscene.world.event_detector import detect_changes
from tiscene.world.lights import WorldLights, same_lights
from tiscene.world.material_animation import MaterialAnimation
from tiscene.world.object_registry import ObjectRegistry, ObjectSelection
from tiscene.world.overlap_detector import OverlapDetector
from tiscene.world.room_finder import RoomFinder
from tiscene.world.stage_objects import StageObjects, matrix
from tiscene.world.trajectories import Trajectories

NOW = Fraction(0)


@dataclass(eq=False)
class FrameEvaluator:
    """Evaluates a world at its frames.

    Attributes:
        log: the edit log, which may grow.
        registry: what no frame changes of the objects.
        stage_objects: the stage's own objects.
        lights: the lights.
        materials: the materials that vary over time.
        trajectories: poses of objects, cameras and lights.
        overlaps: finds what objects are placed inside of.
        fps: frames per second.
        rooms: finds the rooms of objects.
    """

    log: EditLog
    registry: ObjectRegistry
    stage_objects: StageObjects
    lights: WorldLights
    materials: MaterialAnimation
    trajectories: Trajectories
    overlaps: OverlapDetector
    fps: float
    rooms: RoomFinder
    _starting_lights: tuple[LightGroups, ...] | None = None

    def place(self, frame: int, shift: Fraction = NOW) -> Placement:
        """Place every instance at `frame - 1`, `frame + shift` and `frame + 1`, in new read-only arrays.

        Before frame 0 the world stands as at frame 0. An object that is not alive at one of the three times is not
        present then, but keeps the pose of its trajectory, so that motion is defined at spawn and despawn. Spawned
        objects that are not alive at any of the three times have no rows.
        """
        selection = self._selection(frame)
        columns, rows = selection.columns, selection.rows
        count, total = columns.stage, len(columns.mesh)
        previous, shift = max(frame - 1, 0), max(shift, Fraction(-frame))
        seconds = np.array([previous, float(frame + shift), frame + 1]) / self.fps
        world = np.empty((3, total, 3, 4))
        present = np.ones((3, total), dtype=np.bool_)
        self.stage_objects.place(frame, seconds, world, present)
        if count < total:
            # The next frame is the one planned now: edits are not anticipated.
            before, now, after = (
                self.trajectories.poses(previous, rows),
                self.trajectories.between(frame, shift, rows),
                self.trajectories.arrivals(frame + 1, rows),
            )
            poses = np.stack([before, now, after])[:, selection.owner]
            axes = matrix_from_quaternion(poses[..., 3:])
            # einsum, not matmul: its sums have one fixed order, whatever library numpy was built with.
            inner = [selection.tracks.at(second) for second in seconds.tolist()]
            own = np.stack([matrices for matrices, _ in inner])
            world[:, count:] = np.einsum("tpij,tpjk->tpik", axes, own)
            world[:, count:, :, 3] += poses[..., :3]
            for time, step in enumerate((-1, 0, 1)):
                alive = [self.log.histories[row].alive(max(frame + step, 0), as_of=frame) for row in rows]
                present[time, count:] = np.array(alive)[selection.owner] & inner[time][1]
        lights = self._lights_at(frame, shift) if self.has_dynamic_lights(frame) else None
        placement = Placement(
            mesh=columns.mesh.copy(),
            instance_id=columns.instance_id.copy(),
            category_id=columns.category_id.copy(),
            world_from_object=world,
            box_from_object=columns.box_from_mesh.copy(),
            present=present,
            lights=lights,
            part=columns.part.copy(),
            seconds=seconds,
            light_groups=None if lights is None else self.lights.groups(lights),
            materials=self.materials.at(float(seconds[1])) or None,
            color=self._colors(selection, seconds.tolist()),
        )
        for array in vars(placement).values():
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
        return placement

    def _colors(self, selection: ObjectSelection, seconds: Sequence[float]) -> NDArray[np.float32] | None:
        """Return the colors of the instances at some times (s): float32 [times, n, 4]; None if none has its own."""
        stage, objects = self.registry.stage_colors, selection.colors
        if not (stage or objects):
            return None
        return np.stack([np.concatenate([stage.at(second), objects.at(second)]) for second in seconds])

    def objects(self, frame: int) -> list[ObjectState]:
        """Return the rows of all live objects at a frame, by id."""
        objects = self.stage_objects.rows(frame)
        selection = self._selection(frame)
        rows = selection.rows
        if rows:
            now, after = self.trajectories.poses(frame, rows), self.trajectories.arrivals(frame + 1, rows)
            velocities = ((after[:, :3] - now[:, :3]) * self.fps).tolist()
            blocked = self.trajectories.blocked(frame, rows)
            states = zip(rows, selection.objects, now.tolist(), velocities, blocked, strict=True)
            for row, each, (x, y, z, *rotation), velocity, is_blocked in states:
                if self.log.histories[row].alive(frame, as_of=frame):
                    position, turned, moving = (x, y, z), tuple(rotation), tuple(velocity)
                    objects.append(
                        replace(each, position=position, rotation=turned, velocity=moving, blocked=is_blocked)
                    )
        return self.rooms.assign(objects)

    def _selection(self, frame: int) -> ObjectSelection:
        """Return the objects of the scenario that have rows in the placement of a frame."""
        return self.registry.select(self.log.around(frame))

    def _lights_at(
        self, frame: int, shift: Fraction = NOW, *, following: bool = False
    ) -> tuple[tuple[int, Light], ...]:
        """Return the lights, as planned when a frame was made, each with the row of its description.

        Args:
            frame: the frame.
            shift: offset in frames, -1..1; to frame 0 or later.
            following: return those of `frame + 1`, whatever `shift` is.
        """
        shift = Fraction(1) if following else shift
        selection = self._selection(frame)
        carriers = {each.object for each in selection.lights}
        objects = {}
        if carriers:
            rows, trajectories = selection.rows, self.trajectories
            poses = trajectories.arrivals(frame + 1, rows) if following else trajectories.between(frame, shift, rows)
            for row, pose in zip(rows, poses, strict=True):
                if row in carriers and self.log.histories[row].alive(frame + following, as_of=frame):
                    objects[row] = matrix(pose)
        moved = self.trajectories.light_poses(frame + shift)
        matrices = np.array([matrix(pose) for pose in moved]).reshape(-1, 4, 4)
        time = float(frame + shift) / self.fps
        carries = functools.partial(self.stage_objects.carries, frame=frame)
        return self.lights.at(time, matrices, carries, selection.lights, objects)

    def has_dynamic_lights(self, frame: int) -> bool:
        """Return whether any light is known at a frame to move, appear, vanish or change at some frame."""
        if self.lights.has_changes:
            return True
        starts = self.registry.first_light_frame, self.stage_objects.first_edit_frame
        return any(start is not None and start <= frame for start in starts)

    def are_starting_lights(self, frame: int, groups: LightGroups | None) -> bool:
        """Return whether the lights of a frame are those of frames 0 and 1 as planned at frame 0, except for intensity.

        One frame at which a moving lamp stands as at the start does not count: frame 1 must be like it too.

        Args:
            frame: the frame.
            groups: its lights; None: those of the stage, which never change.
        """
        emission, *starting = (self.materials.stage_emission_at(each / self.fps) for each in (frame, 0, 1))
        if any(each != emission for each in starting):
            return False
        if self._starting_lights is None and groups is not None:
            starts = self._lights_at(0), self._lights_at(0, following=True)
            self._starting_lights = tuple(self.lights.groups(lights) for lights in starts)
        return groups is None or all(same_lights(groups, start) for start in self._starting_lights or ())

    def forget_starting_lights(self) -> None:
        """Compute the lights of frames 0 and 1 again, after an edit at frame 0 or a replacement of a light."""
        self._starting_lights = None

    def movers(self, frame: int) -> NDArray[np.bool_]:
        """Return for every instance whether it is known at `frame` to move, deform, appear or vanish after frame 0."""
        selection = self._selection(frame)
        count = selection.columns.stage
        moving = np.zeros(len(selection.columns.mesh), bool)
        dynamic = np.array([not self.log.histories[row].is_static(as_of=frame) for row in selection.rows], bool)
        moving[count:] = dynamic[selection.owner]
        moving[:count] = self.stage_objects.edited_parts(frame)
        return moving | selection.changing

    def changes(self, frame: int) -> tuple[Event, ...]:
        """Return spawns, despawns, contacts and overlaps since the frame before."""
        histories = {row: self.log.histories[row] for row in self.log.around(frame)}
        collisions = self.trajectories.collisions(frame)
        stage, edited, overlaps = self.registry.stage, self.stage_objects.histories, self.overlaps.find(frame)
        return detect_changes(frame, stage, edited, histories, collisions, overlaps)
