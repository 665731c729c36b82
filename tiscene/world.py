"""World: where everything is at each frame. Bodies move, so instances move.

A pure function of (scenario, stage, fps, aspect, frame): nothing depends on which frames were asked for before.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion
from tiscene.camera import Camera, Quaternion, Vector3, quaternion_from_matrix
from tiscene.errors import ArgumentError, CameraNotFound, ScenarioError
from tiscene.motion import WALLS, Motion
from tiscene.scenario import Object, Scenario
from tiscene.scene.description import SceneDescription, Template
from tiscene.scene.parts import Parts, bounding_box, box_matrices, corners, joined, rigid
from tiscene.scene.placement import Placement

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WorldObject:
    """A live object at one frame.

    id: the instance label. name: the scenario's id, or the prim's name. template: "" for what stands on the stage.
    prim_path: "" for objects of the scenario.
    position: m. rotation: unit quaternion. They place the object's own axes; scale is in the box, not in them.
    velocity: m/s, of the origin, from this frame to the next along its path.
    box: lowest and highest corner around the object in its own axes, m.
    first_frame, last_frame: its life span, both inclusive; None: no end.
    blocked: something has kept it from its way since the frame before.
    """

    id: int
    name: str
    template: str
    category: str
    category_id: int
    prim_path: str
    position: Vector3
    rotation: Quaternion
    velocity: Vector3
    box: tuple[Vector3, Vector3]
    first_frame: int
    last_frame: int | None
    blocked: bool = False


@dataclass(frozen=True)
class Event:
    """Something that happened to an object at a frame.

    kind: "spawn": it is there for the first time. "despawn": it is not there any more. "contact": it met something.
    object: its id. other: of a contact the id of the object that it met, 0 for a wall. wall: its name, such as "left".
    """

    kind: Literal["spawn", "despawn", "contact"]
    object: int
    other: int = 0
    wall: str = ""


class World:
    """The stage's things and the scenario's objects, on the clock of a stream.

    Ids: things of the stage have 1 to n in the stage's order, objects of the scenario the following ones in theirs.
    Categories: 0 is the background (""); the others are numbered as they first appear among the stage's things, the
    stage's templates and the scenario's objects, so that all scenarios in one scene agree on the scene's categories.
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
        self.descriptions = [stage]
        self.categories = {0: ""}
        self._category_ids = {"": 0}
        self._templates: dict[str, Template] = {}
        for template in stage.templates:
            self._templates.setdefault(template.name, template)
        self._first_mesh: dict[str, int] = {}
        for category in (*(thing.category for thing in stage.objects), *(each.category for each in stage.templates)):
            self._category_id(category)

        self._stage_rows, stage_parts = self._settle_stage()
        self._object_rows, object_parts = self._settle_objects(load_template)
        self._owner = object_parts.owner
        self._matrix = object_parts.matrix
        self._fixed = self._fixed_columns(stage_parts, object_parts)
        self._motion = Motion(scenario, stage, self.camera, fps, aspect, self._surface)

    @property
    def templates(self) -> list[str]:
        """Names of the templates that the stage holds or the scenario uses, sorted."""
        return sorted(self._templates)

    def placement(self, frame: int) -> Placement:
        """Every mesh at the frames before, at and after `frame`, in new arrays.

        Before frame 0 the world stands as at frame 0. Objects that are not alive at one of the three are not
        present then, but have the pose that their path gives them, so that motion is defined at spawn and despawn.
        """
        frame = _frame_number(frame)
        still, mesh, instance_id, category_id, box = self._fixed
        count = len(still)
        world = np.empty((3, len(mesh), 3, 4))
        present = np.ones((3, len(mesh)), dtype=np.bool_)
        world[:, :count] = still
        if count < len(mesh):
            poses = np.stack([self._motion.poses(frame + step)[self._owner] for step in (-1, 0, 1)])
            axes = matrix_from_quaternion(poses[..., 3:])
            # einsum, not matmul: its sums have one fixed order, whatever library numpy was built with.
            world[:, count:] = np.einsum("tpij,pjk->tpik", axes, self._matrix)
            world[:, count:, :, 3] += poses[..., :3]
            for time, step in enumerate((-1, 0, 1)):
                alive = [each.alive(max(frame + step, 0)) for each in self.scenario.objects]
                present[time, count:] = np.array(alive)[self._owner]
        return Placement(mesh.copy(), instance_id.copy(), category_id.copy(), world, box.copy(), present)

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
        rows = list(self._stage_rows)
        if self._object_rows:
            now, after = self._motion.poses(frame), self._motion.poses(frame + 1)
            velocities = ((after[:, :3] - now[:, :3]) * self.fps).tolist()
            blocked = self._motion.blocked(frame)
            for row, pose, velocity, stuck in zip(self._object_rows, now.tolist(), velocities, blocked, strict=False):
                if row.first_frame <= frame and (row.last_frame is None or frame <= row.last_frame):
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
        for number, each in enumerate(self.scenario.objects):
            if each.first_frame == frame:
                events.append(Event("spawn", first + number))
            elif each.last_frame is not None and each.last_frame + 1 == frame:
                events.append(Event("despawn", first + number))
        for meeting in self._motion.meetings(frame):
            if meeting.kind == "wall":
                events.append(Event("contact", first + meeting.number, wall=WALLS[meeting.other]))
            else:
                start = 1 if meeting.kind == "stage" else first
                events.append(Event("contact", first + meeting.number, start + meeting.other))
        return events

    def _surface(self, number: int) -> Array:
        """The triangles [m, 3, 3] of an object of the scenario in its own axes, m."""
        meshes = [mesh for description in self.descriptions for mesh in description.meshes]
        count = len(self._fixed[0])
        triangles = [np.zeros((0, 3, 3))]
        for part in np.flatnonzero(self._owner == number):
            mesh, matrix = meshes[self._fixed[1][count + part]], self._matrix[part]
            triangles.append((mesh.positions.astype(np.float64) @ matrix[:, :3].T + matrix[:, 3])[mesh.triangles])
        return np.concatenate(triangles)

    def _category_id(self, category: str) -> int:
        number = self._category_ids.setdefault(category, len(self._category_ids))
        self.categories[number] = category
        return number

    def _settle_stage(self) -> tuple[list[WorldObject], Parts]:
        """Rows and parts of the stage's things. Their own axes are those of their first mesh, without its scale."""
        groups: list[list[int]] = [[] for _ in self.stage.objects]
        for row, instance in enumerate(self.stage.instances):
            groups[instance.object].append(row)
        rows, parts = [], []
        for number, (thing, group) in enumerate(zip(self.stage.objects, groups, strict=True)):
            axes = np.eye(4)
            if group:
                axes = rigid(self.stage.instances[group[0]].world_from_object)
            own = [np.linalg.inv(axes) @ self.stage.instances[row].world_from_object for row in group]
            meshes = [self.stage.instances[row].mesh for row in group]
            box = bounding_box(self.stage, meshes, own)
            x, y, z = axes[:3, 3].tolist()
            rows.append(
                WorldObject(
                    id=number + 1,
                    name=thing.name,
                    template="",
                    category=thing.category,
                    category_id=self._category_id(thing.category),
                    prim_path=thing.prim_path,
                    position=(x, y, z),
                    rotation=quaternion_from_matrix(axes[:3, :3]),
                    velocity=(0.0, 0.0, 0.0),
                    box=corners(box),
                    first_frame=0,
                    last_frame=None,
                )
            )
            parts.append(
                Parts(
                    np.array(meshes, dtype=np.int32),
                    np.full(len(group), number, dtype=np.int32),
                    # Not axes @ own: the stage's matrices are kept to the bit.
                    np.array([self.stage.instances[row].world_from_object[:3] for row in group]).reshape(-1, 3, 4),
                    box_matrices(box, own),
                )
            )
        return rows, joined(parts)

    def _settle_objects(self, load_template: Callable[[str], Template]) -> tuple[list[WorldObject], Parts]:
        """Rows and parts of the scenario's objects; adds the templates' meshes to `descriptions`."""
        rows, parts = [], []
        for number, each in enumerate(self.scenario.objects):
            template = self._template(each, load_template)
            description = template.description
            scale = np.diag([*np.broadcast_to(each.scale, 3), 1.0])
            own = [scale @ instance.world_from_object for instance in description.instances]
            meshes = [instance.mesh for instance in description.instances]
            box = bounding_box(description, meshes, own)
            rows.append(
                WorldObject(
                    id=len(self.stage.objects) + number + 1,
                    name=each.id,
                    template=template.name,
                    category=template.category,
                    category_id=self._category_id(template.category),
                    prim_path="",
                    position=each.position,
                    rotation=(1.0, 0.0, 0.0, 0.0),
                    velocity=(0.0, 0.0, 0.0),
                    box=corners(box),
                    first_frame=each.first_frame,
                    last_frame=each.last_frame,
                )
            )
            parts.append(
                Parts(
                    np.array(meshes, dtype=np.int32) + self._first_mesh[each.template],
                    np.full(len(meshes), number, dtype=np.int32),
                    np.array([matrix[:3] for matrix in own]),
                    box_matrices(box, own),
                )
            )
        return rows, joined(parts)

    def _template(self, each: Object, load_template: Callable[[str], Template]) -> Template:
        """An object's template, its meshes among the world's from now on."""
        if each.template not in self._templates:
            self._templates[each.template] = load_template(each.template)
        template = self._templates[each.template]
        if each.template not in self._first_mesh:
            if not template.description.instances:
                raise ScenarioError(f"object {each.id!r}: the template {each.template!r} holds no mesh")
            self._first_mesh[each.template] = sum(len(description.meshes) for description in self.descriptions)
            self.descriptions.append(template.description)
        return template

    def _fixed_columns(
        self, stage: Parts, objects: Parts
    ) -> tuple[Array, NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], Array]:
        """What no frame changes: the stage's matrices, and of all parts the mesh, ids and box."""
        rows = [self._stage_rows[owner] for owner in stage.owner] + [self._object_rows[row] for row in objects.owner]
        return (
            stage.matrix,
            np.concatenate([stage.mesh, objects.mesh]),
            np.array([row.id for row in rows], dtype=np.int32),
            np.array([row.category_id for row in rows], dtype=np.int32),
            np.concatenate([stage.box_from_mesh, objects.box_from_mesh]),
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
