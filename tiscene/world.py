"""World: where everything is at each frame. Bodies move, so instances move.

A pure function of (scenario with its edits, stage, fps, aspect, frame): nothing depends on which frames were asked for
before.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import Dynamic
from dynamics.rotation import matrix_from_quaternion
from tiscene.camera import Camera
from tiscene.edits import Despawn, Edit, Move, Spawn
from tiscene.errors import ArgumentError, CameraNotFound, ObjectNotFound, ScenarioError
from tiscene.events import Event
from tiscene.inventory import Inventory, WorldObject
from tiscene.motion import WALLS, Motion
from tiscene.scenario import Object, Scenario
from tiscene.scene.description import SceneDescription, Template
from tiscene.scene.placement import Placement

Array = NDArray[np.float64]


class World:
    """The stage's things and the scenario's objects, on the clock of a stream.

    Ids: things of the stage have 1 to n in the stage's order, objects of the scenario the following ones in theirs.
    Categories: 0 is the background (""); the others are numbered as they first appear among the stage's things, the
    stage's templates and the scenario's objects, so that all scenarios in one scene agree on the scene's categories.

    A stream that runs may be edited: `spawn`, `despawn`, `move` take effect at its next frame and are kept in
    `scenario.edits`, so that a world made of that scenario does the same at the same frames.

    scenario: what was asked for, and the edits. next_frame: the one that the stream gives next.
    """

    def __init__(
        self,
        scenario: Scenario,
        stage: SceneDescription,
        load_template: Callable[[str], Template],
        fps: float,
        aspect: float = 4.0 / 3.0,
    ) -> None:
        """load_template: finds what the stage does not hold, or raises TemplateNotFound. fps: frame k is at k / fps.

        aspect: width / height of the view, which a frustum's walls enclose.
        The camera is the scenario's, else the stage's first, else one that sees the whole stage.
        Raises ScenarioError, CameraNotFound, ArgumentError, and what `load_template` raises.
        """
        if isinstance(fps, bool) or not np.isfinite(fps) or fps <= 0:
            raise ArgumentError(f"fps={fps!r}: must be a positive number of frames per second")
        self.scenario = scenario
        self.stage = stage
        self.fps = fps
        self.camera = _chosen_camera(scenario, stage)
        self.next_frame = 0
        self._aspect = aspect
        self._inventory = Inventory(stage, load_template)
        self._lives = scenario.lives()
        self._inventory.settle(self._lives)
        self._motion = Motion(scenario, stage, self.camera, fps, aspect, self._inventory.surface)

    @property
    def templates(self) -> list[str]:
        """Names of the templates that the stage holds or the scenario uses, sorted."""
        return sorted(self._inventory.templates)

    @property
    def descriptions(self) -> list[SceneDescription]:
        """The stage, then the templates in the order in which they were needed first: the meshes of placements."""
        return self._inventory.descriptions

    @property
    def categories(self) -> dict[int, str]:
        """What category ids mean; 0 is the background."""
        return self._inventory.categories

    def placement(self, frame: int) -> Placement:
        """Every mesh at the frames before, at and after `frame`, in new arrays.

        Before frame 0 the world stands as at frame 0. Objects that are not alive at one of the three are not
        present then, but have the pose that their path gives them, so that motion is defined at spawn and despawn.
        """
        frame = _frame_number(frame)
        inventory = self._inventory
        still, mesh, instance_id, category_id, box = inventory.columns
        count = len(still)
        world = np.empty((3, len(mesh), 3, 4))
        present = np.ones((3, len(mesh)), dtype=np.bool_)
        world[:, :count] = still
        if count < len(mesh):
            # What comes is shown as it is planned now: edits are not anticipated.
            before, now, after = (
                self._motion.poses(frame - 1),
                self._motion.poses(frame),
                self._motion.arrivals(frame + 1),
            )
            poses = np.stack([before, now, after])[:, inventory.owner]
            axes = matrix_from_quaternion(poses[..., 3:])
            # einsum, not matmul: its sums have one fixed order, whatever library numpy was built with.
            world[:, count:] = np.einsum("tpij,pjk->tpik", axes, inventory.matrix)
            world[:, count:, :, 3] += poses[..., :3]
            for time, step in enumerate((-1, 0, 1)):
                alive = [life.alive(max(frame + step, 0), known=frame) for life in self._lives]
                present[time, count:] = np.array(alive)[inventory.owner]
        return Placement(mesh.copy(), instance_id.copy(), category_id.copy(), world, box.copy(), present)

    def moving(self, frame: int) -> NDArray[np.bool_]:
        """Of every mesh of the placement at `frame`, whether it ever moves, comes or goes, as far as is known then."""
        frame = _frame_number(frame)
        still, mesh = self._inventory.columns[:2]
        moving = np.zeros(len(mesh), bool)
        restless = np.array([not life.rests(known=frame) for life in self._lives], bool)
        moving[len(still) :] = restless[self._inventory.owner]
        return moving

    def cameras(self, frame: int) -> tuple[Camera, Camera, Camera]:
        """The camera at the frames before, at and after `frame`."""
        frame = _frame_number(frame)
        if self.camera.dynamic is None:
            return (self.camera, self.camera, self.camera)
        before, now, after = (self._motion.poses(frame + step)[-1].tolist() for step in (-1, 0, 1))
        return (
            self.camera.posed(tuple(before[:3]), tuple(before[3:])),
            self.camera.posed(tuple(now[:3]), tuple(now[3:])),
            self.camera.posed(tuple(after[:3]), tuple(after[3:])),
        )

    def objects(self, frame: int) -> list[WorldObject]:
        """Everything that is alive at `frame`, in the order of ids."""
        frame = _frame_number(frame)
        rows = list(self._inventory.stage_rows)
        if self._inventory.object_rows:
            now, after = self._motion.poses(frame), self._motion.arrivals(frame + 1)
            velocities = ((after[:, :3] - now[:, :3]) * self.fps).tolist()
            blocked = self._motion.blocked(frame)
            states = zip(self._lives, self._inventory.object_rows, now.tolist(), velocities, blocked, strict=False)
            for life, row, pose, velocity, stuck in states:
                if life.alive(frame, known=frame):
                    x, y, z, *rotation = pose
                    rows.append(
                        replace(
                            row,
                            position=(x, y, z),
                            rotation=tuple(rotation),
                            velocity=tuple(velocity),
                            blocked=stuck,
                        )
                    )
        return rows

    def events(self, frame: int) -> list[Event]:
        """What has happened since the frame before: spawns and despawns, then what met what, each in order of ids."""
        frame = _frame_number(frame)
        first = len(self.stage.objects) + 1
        events = []
        for number, life in enumerate(self._lives):
            if life.planned.first_frame == frame:
                events.append(Event("spawn", first + number))
            elif life.last_frame is not None and life.last_frame + 1 == frame:
                events.append(Event("despawn", first + number))
        for meeting in self._motion.meetings(frame):
            if meeting.kind == "wall":
                events.append(Event("contact", first + meeting.number, wall=WALLS[meeting.other]))
            else:
                start = 1 if meeting.kind == "stage" else first
                events.append(Event("contact", first + meeting.number, start + meeting.other))
        return events

    def spawn(
        self,
        template: str,
        position: Sequence[float] = (0.0, 0.0, 0.0),
        rotation: Sequence[float] = (0.0, 0.0, 0.0),
        dynamic: Dynamic | None = None,
        *,
        id: str | None = None,
        **others: Any,
    ) -> int:
        """Let an object appear at the next frame, `next_frame`; its clock runs from then on. Returns its instance id.

        id: its name in the scenario; by default one is made. others: fields of `Object`: last_frame, frustum_limited,
        collide, scale. Raises ScenarioError, TemplateNotFound, changing nothing.
        """
        if id is None:
            id = f"spawned_{sum(isinstance(edit, Spawn) for edit in self.scenario.edits) + 1}"
        new = Object(id, template, position, rotation, dynamic, first_frame=self.next_frame, **others)  # type: ignore[arg-type]
        self._inventory.template(new)
        self._edit(Spawn(self.next_frame, new))
        return self._inventory.object_rows[-1].id

    def despawn(self, object: int | str) -> None:
        """Let an object of the scenario, by its instance id or name, be gone from the next frame on.

        Raises ObjectNotFound if it is not there then.
        """
        self._edit(Despawn(self.next_frame, self._live_name(object)))

    def move(self, object: int | str, position: Sequence[float], rotation: Sequence[float] | None = None) -> None:
        """Put an object of the scenario, by its instance id or name, elsewhere at the next frame.

        rotation: Euler degrees or a quaternion; None: as it is now. What follows a path returns to it from there, what
        bounces goes on in its direction. Raises ObjectNotFound if it is not there then, ScenarioError.
        """
        name = self._live_name(object)
        if rotation is None:
            row = next(row for row, life in enumerate(self._lives) if life.planned.id == name)
            rotation = self._motion.arrivals(self.next_frame)[row, 3:].tolist()
        try:
            edit = Move(self.next_frame, name, position, rotation)  # type: ignore[arg-type]
        except (TypeError, ValueError) as error:
            raise ScenarioError(f"move: {error}") from error
        self._edit(edit)

    def _live_name(self, object: int | str) -> str:
        """The name of an object that is there at the next frame."""
        frame = self.next_frame
        there = {
            row.id: life.planned.id
            for row, life in zip(self._inventory.object_rows, self._lives, strict=True)
            if life.alive(frame, known=frame)
        }
        if object in there.values():
            return str(object)
        if isinstance(object, bool) or object not in there:
            known = [f"{name} ({number})" for number, name in there.items()]
            raise ObjectNotFound("object", str(object), known, f" of the scenario at frame {frame}")
        return there[int(object)]

    def _edit(self, edit: Edit) -> None:
        self.scenario = replace(self.scenario, edits=(*self.scenario.edits, edit))
        self._lives = self.scenario.lives()
        self._inventory.settle(self._lives)
        before = self._motion, edit.frame
        self._motion = Motion(
            self.scenario, self.stage, self.camera, self.fps, self._aspect, self._inventory.surface, before
        )


def _chosen_camera(scenario: Scenario, stage: SceneDescription) -> Camera:
    if isinstance(scenario.camera, Camera):
        return scenario.camera
    if scenario.camera is None and stage.cameras:
        return stage.cameras[0]
    if scenario.camera is None:
        (a, b, c), (d, e, f) = stage.bounds().tolist()
        return Camera.seeing((a, b, c), (d, e, f), (0.0, 1.0, 0.0) if stage.up_axis == "Y" else (0.0, 0.0, 1.0))
    for camera in stage.cameras:
        if camera.name == scenario.camera:
            return camera
    raise CameraNotFound("camera", scenario.camera, [each.name for each in stage.cameras], f" in scene {stage.name!r}")


def _frame_number(frame: int) -> int:
    number = operator.index(frame)
    if number < 0:
        raise ArgumentError(f"frame={frame}: must be 0 or more")
    return number
