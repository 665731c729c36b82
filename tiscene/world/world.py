# SPDX-License-Identifier: Apache-2.0
"""World: where everything is at each frame. Bodies move, so instances move.

A pure function of (scenario with its edits, stage, fps, aspect, frame): nothing depends on which frames were asked for
before.
"""

from __future__ import annotations

import functools
import itertools
import operator
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynamics import Dynamic
from dynamics.rotation import matrix_from_quaternion
from tiscene.errors import ArgumentError, ObjectNotFound, ScenarioError
from tiscene.frame.events import Event
from tiscene.scenario.edits import Despawn, Edit, Move, SetFrustumWalls, Spawn
from tiscene.scenario.objects import Frustum, Object
from tiscene.scenario.scenario import Scenario
from tiscene.scene.bvh.obstacle_tree import MeshTrees
from tiscene.scene.camera import Camera
from tiscene.scene.description import Light, SceneDescription, Template
from tiscene.scene.lights.light_groups import LightGroups
from tiscene.scene.placement import Placement
from tiscene.validation import positive
from tiscene.world.event_detector import EventDetector
from tiscene.world.lights import WorldLights
from tiscene.world.object_registry import ObjectRegistry, WorldObject
from tiscene.world.stage_objects import StageObjects, matrix
from tiscene.world.trajectories import Trajectories, TrajectoryContext

Array = NDArray[np.float64]
NOW = Fraction(0)


class World:
    """The stage's things and the scenario's objects, on the clock of a stream.

    Ids: things of the stage have 1 to n in the stage's order, objects of the scenario the following ones in theirs.
    Categories: 0 is the background (""); the others are numbered as they first appear among the stage's things, the
    stage's templates and the scenario's objects, so that all scenarios in one scene agree on the scene's categories.

    A stream that runs may be edited: `spawn`, `despawn`, `move` take effect at its next frame and are kept in
    `scenario.edits`, so that a world made of that scenario does the same at the same frames.

    next_frame: the one that the stream gives next. cameras: all that watch, as the scenario has them.
    """

    def __init__(
        self,
        scenario: Scenario,
        stage: SceneDescription,
        load_template: Callable[[str], Template],
        fps: float,
        aspect: float = 4.0 / 3.0,
        trees: Callable[[], MeshTrees] | None = None,
    ) -> None:
        """load_template: finds what the stage does not hold, or raises TemplateNotFound. fps: frame k is at k / fps.

        aspect: width / height of the view, which a frustum's walls enclose. trees: those over the stage's meshes, where
        somebody renders them; asked for if objects collide.
        The camera is the scenario's, else the stage's first, else one that sees the whole stage.
        Raises ScenarioError, CameraNotFound, LightNotFound, ArgumentError, and what `load_template` raises.
        """
        self._asked = scenario
        self._log = scenario.log()
        self.stage = stage
        self.fps = positive("fps", fps)
        self.cameras = tuple(each if isinstance(each, Camera) else stage.camera(each) for each in scenario.cameras)
        names = [camera.name for camera in self.cameras]
        if len(set(names)) < len(names):
            raise ScenarioError(f"camera: {', '.join(names)}: two of them have one name")
        self.next_frame = 0
        self._first_lights: tuple[LightGroups, LightGroups] | None = None
        self._aspect = aspect
        self._inventory = ObjectRegistry(stage, load_template)
        self._lives = self._log.lives
        inventory = self._inventory
        self._things = StageObjects(stage, inventory.stage_rows, inventory.stage_owner, inventory.stage_tracks, fps)
        self._things.settle(self._log.stage)
        self._inventory.settle(self._lives)
        self._witness = EventDetector(stage, self._things, self._lives, self.objects)
        self._lighting = WorldLights(stage, scenario.lights)
        self._setting = TrajectoryContext(
            stage=stage,
            cameras=self.cameras,
            fps=fps,
            aspect=aspect,
            lights=[
                (motion.dynamic, *pose) for motion, pose in zip(scenario.lights, self._lighting.poses(), strict=True)
            ],
            surface=self._inventory.surface,
            trees=functools.cache(trees or (lambda: MeshTrees.built(stage.meshes))),
            instances=self._things.instances,
        )
        self._motion = Trajectories(scenario, self._log, self._setting)

    @property
    def scenario(self) -> Scenario:
        """What was asked for, and the edits."""
        if len(self._asked.edits) < len(self._log.edits):
            self._asked = replace(self._asked, edits=tuple(self._log.edits))
        return self._asked

    @property
    def camera(self) -> Camera:
        """The main camera."""
        return self.cameras[0]

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

    def placement(self, frame: int, shift: Fraction = NOW) -> Placement:
        """Every mesh at the frames before, at and after `frame`, in new arrays.

        shift: by so many frames, -1..1, the middle one of the three is another moment, such as while a shutter is open.

        Before frame 0 the world stands as at frame 0. Objects that are not alive at one of the three are not
        present then, but have the pose that their path gives them, so that motion is defined at spawn and despawn.
        """
        frame = _frame_number(frame)
        inventory, columns = self._inventory, self._inventory.columns
        count, total = columns.stage, len(columns.mesh)
        seconds = np.array([max(frame - 1, 0), max(float(frame + shift), 0.0), frame + 1]) / self.fps
        world = np.empty((3, total, 3, 4))
        present = np.ones((3, total), dtype=np.bool_)
        self._things.place(frame, seconds, world, present)
        if count < total:
            # What comes is shown as it is planned now: edits are not anticipated.
            before, now, after = (
                self._motion.poses(frame - 1),
                self._motion.between(frame, shift),
                self._motion.arrivals(frame + 1),
            )
            poses = np.stack([before, now, after])[:, inventory.owner]
            axes = matrix_from_quaternion(poses[..., 3:])
            # einsum, not matmul: its sums have one fixed order, whatever library numpy was built with.
            inner = [inventory.object_tracks.at(second) for second in seconds.tolist()]
            own = np.stack([matrices for matrices, _ in inner])
            world[:, count:] = np.einsum("tpij,tpjk->tpik", axes, own)
            world[:, count:, :, 3] += poses[..., :3]
            for time, step in enumerate((-1, 0, 1)):
                alive = [life.alive(max(frame + step, 0), as_of=frame) for life in self._lives]
                present[time, count:] = np.array(alive)[inventory.owner] & inner[time][1]
        lights = self._lights(frame, shift)
        groups = None if lights is None else self._lighting.groups(lights)
        return Placement(
            mesh=columns.mesh.copy(),
            instance_id=columns.instance_id.copy(),
            category_id=columns.category_id.copy(),
            world_from_object=world,
            box_from_object=columns.box_from_mesh.copy(),
            present=present,
            lights=lights,
            part=columns.part.copy(),
            seconds=seconds,
            light_groups=groups,
        )

    def lights(self, frame: int) -> list[Light]:
        """The lights at `frame`: where they are, and how they shine."""
        lights = self._lights(_frame_number(frame))
        return list(self.stage.lights) if lights is None else [light for _, light in lights]

    def light_groups(self, frame: int) -> LightGroups:
        """The lights at `frame`, how bright they are told apart."""
        lights = self._lights(_frame_number(frame))
        return self._lighting.groups(tuple((0, light) for light in self.stage.lights) if lights is None else lights)

    @property
    def initial_lights(self) -> tuple[LightGroups, LightGroups]:
        """Those at frames 0 and 1: the same object until an edit changes them."""
        if self._first_lights is None:
            self._first_lights = self.light_groups(0), self.light_groups(1)
        return self._first_lights

    def relight(self, row: int, light: Light) -> None:
        """See `Stream.relight`: no part of the scenario."""
        self._lighting.relight(row, light)
        self._first_lights = None

    def _lights(self, frame: int, shift: Fraction = NOW) -> tuple[tuple[int, Light], ...] | None:
        """Each with the row of its description; None if they are the stage's as it was read, always."""
        if not self.has_dynamic_lights:
            return None
        carried = self._inventory.carried
        poses = self._motion.between(frame, shift)
        objects: list[Array | None] = [None] * len(self._lives)
        for row in {each.object for each in carried}:
            if self._lives[row].alive(frame, as_of=frame):
                objects[row] = matrix(poses[row])
        matrices = np.array([matrix(pose) for pose in poses[len(self._lives) + len(self.cameras) :]]).reshape(-1, 4, 4)
        time = max(float(frame + shift), 0.0) / self.fps
        return self._lighting.at(time, matrices, lambda path: self._things.carries(path, frame), carried, objects)

    @property
    def has_dynamic_lights(self) -> bool:
        """Whether any light may move, come, go or shine otherwise, at some frame."""
        return bool(self._asked.lights or self._inventory.carried or self._things.lives or self._lighting.relit)

    def moving(self, frame: int) -> NDArray[np.bool_]:
        """Of every mesh of the placement at `frame`, whether it is known then to move, deform, come or go ever."""
        frame = _frame_number(frame)
        count = self._inventory.columns.stage
        moving = np.zeros(len(self._inventory.columns.mesh), bool)
        restless = np.array([not life.is_static(as_of=frame) for life in self._lives], bool)
        moving[count:] = restless[self._inventory.owner]
        moving[:count] = self._things.restless(frame)
        return moving | self._inventory.changing

    def view(self, frame: int, camera: int = 0) -> tuple[Camera, Camera, Camera]:
        """A camera, by its row in `cameras`, at the frames before, at and after `frame`."""
        frame = _frame_number(frame)
        chosen = self.cameras[camera]
        if chosen.dynamic is None:
            return (chosen, chosen, chosen)
        row = len(self._lives) + camera
        before, now, after = (self._motion.poses(frame + step)[row].tolist() for step in (-1, 0, 1))
        return (
            chosen.with_pose(tuple(before[:3]), tuple(before[3:])),
            chosen.with_pose(tuple(now[:3]), tuple(now[3:])),
            chosen.with_pose(tuple(after[:3]), tuple(after[3:])),
        )

    def camera_at(self, frame: int, shift: Fraction, camera: int = 0) -> Camera:
        """A camera, by its row in `cameras`, by so many frames, -1..1, from a frame."""
        chosen = self.cameras[camera]
        if chosen.dynamic is None:
            return chosen
        x, y, z, *rotation = self._motion.between(_frame_number(frame), shift)[len(self._lives) + camera].tolist()
        return chosen.with_pose((x, y, z), tuple(rotation))

    def objects(self, frame: int) -> list[WorldObject]:
        """Everything that is alive at `frame`, in the order of ids."""
        frame = _frame_number(frame)
        rows = self._things.rows(frame)
        if self._inventory.object_rows:
            now, after = self._motion.poses(frame), self._motion.arrivals(frame + 1)
            velocities = ((after[:, :3] - now[:, :3]) * self.fps).tolist()
            blocked = self._motion.blocked(frame)
            states = zip(self._lives, self._inventory.object_rows, now.tolist(), velocities, blocked, strict=False)
            for life, row, pose, velocity, stuck in states:
                if life.alive(frame, as_of=frame):
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

    @property
    def initial_objects(self) -> list[WorldObject]:
        """The stage's things as the stage has them, whatever was done to them."""
        return list(self._inventory.stage_rows)

    def events(
        self, frame: int, view: tuple[Camera, Camera, Camera] | None = None, aspect: float | None = None
    ) -> list[Event]:
        """What has happened since the frame before: spawns and despawns, what met what, what came into view and left.

        view: the camera before, at and after the frame that "enter" and "leave" are for, and its width / height; by
        default the main camera's. Something is in view while any of the box around it, in its own axes, lies within
        the sides of the picture in front of the camera, hidden or not. It enters when it is there and in view, and was
        not at the frame before; things of the stage that are in view at frame 0 do not.
        """
        frame = _frame_number(frame)
        before, now, _ = view or self.view(frame)
        return self._witness.events(frame, self._motion.meetings(frame), before, now, aspect or self._aspect)

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
            first = len(self._lives) - len(self._asked.objects) + 1
            names = (f"spawned_{number}" for number in itertools.count(first))
            id = next(name for name in names if self._log.row(name) is None)
        new = Object(id, template, position, rotation, dynamic, first_frame=self.next_frame, **others)  # type: ignore[arg-type]
        self._inventory.template(new)
        self._edit(Spawn(self.next_frame, new))
        return self._inventory.object_rows[-1].id

    def despawn(self, object: int | str) -> None:
        """Let something be gone from the next frame on: by its instance id, an object's name or a thing's prim path.

        Raises ObjectNotFound if it is not there then.
        """
        self._edit(Despawn(self.next_frame, self._live_name(object)))

    def move(self, object: int | str, position: Sequence[float], rotation: Sequence[float] | None = None) -> None:
        """Put something elsewhere at the next frame: by its instance id, an object's name or a thing's prim path.

        rotation: Euler degrees or a quaternion; None: as it is now. What follows a path returns to it from there, what
        bounces goes on in its direction, things of the stage stand. Position and rotation are those that
        `frame.objects` tells. Raises ObjectNotFound if it is not there then, ScenarioError.
        """
        name = self._live_name(object)
        if rotation is None:
            row = self._log.row(name)
            if row is None:
                rotation = next(row.rotation for row in self._things.rows(self.next_frame) if row.prim_path == name)
            else:
                rotation = self._motion.arrivals(self.next_frame)[row, 3:].tolist()
        self._edit(Move(self.next_frame, name, position, rotation))  # type: ignore[arg-type]

    def set_frustum_walls(
        self, frustum: Frustum | None, camera: Camera | None = None, aspect: float | None = None
    ) -> None:
        """Let the walls that hold objects be those of another view from the next frame on.

        frustum: None: there are no walls. camera, aspect: whose view, and its width / height; by default what the main
        camera sees then. Raises ScenarioError.
        """
        if not isinstance(frustum, Frustum | None):
            raise ScenarioError(f"frustum={frustum!r}: must be a Frustum or None")
        if not isinstance(camera, Camera | None):
            raise ScenarioError(f"camera={camera!r}: must be a Camera or None")
        camera = replace(camera or self.view(self.next_frame)[1], dynamic=None)
        self._edit(SetFrustumWalls(self.next_frame, frustum, camera, self._aspect if aspect is None else aspect))

    def _live_name(self, object: int | str) -> str:
        """The scenario's name, or the stage's prim path, of something that is there at the next frame."""
        if not isinstance(object, int | str | np.integer):
            raise ArgumentError(f"object={object!r}: must be an id, a name or a prim path")
        frame, rows = self.next_frame, self._inventory.object_rows
        alive = [life.alive(frame, as_of=frame) for life in self._lives]
        objects = {row.id: row.name for row, there in zip(rows, alive, strict=True) if there}
        stage = enumerate(self._inventory.stage_rows)
        things = {row.id: row.prim_path for number, row in stage if self._things.there(number, frame)}
        names = objects | things
        if object in names.values():
            return str(object)
        if isinstance(object, bool) or object not in names:
            known = list(names.values())
            if not isinstance(object, str):  # too many things to tell are left out
                told = names if len(things) <= 20 else objects
                known = [f"{name} ({number})" for number, name in told.items()]
            raise ObjectNotFound("object", str(object), known, f" at frame {frame}")
        return names[int(object)]

    def _edit(self, edit: Edit) -> None:
        self._log.add(edit)
        self._things.settle(self._log.stage)
        if isinstance(edit, Spawn):
            self._inventory.settle(self._lives)
        self._witness.forget()
        self._motion.amend(edit)
        if edit.frame <= 1:
            self._first_lights = None


def _frame_number(frame: int) -> int:
    number = operator.index(frame)
    if number < 0:
        raise ArgumentError(f"frame={frame}: must be 0 or more")
    return number
