# SPDX-License-Identifier: Apache-2.0
"""World: evaluates a scenario on its stage, frame by frame.

A state is a pure function of (scenario with its edits, stage, fps, aspect, frame): it does not depend on which frames
were requested before.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from copy import deepcopy
from dataclasses import replace
from fractions import Fraction
from types import MappingProxyType

from dynamics import argument_checks
from dynamics.whole_changes import WholeChanges, as_a_whole
from tiscene.errors import ArgumentError, ScenarioError
from tiscene.frame.object_table import ObjectState
from tiscene.scenario.edits import Despawn, Edit, Move, PlaceCamera, Spawn
from tiscene.scenario.scenario import Scenario
from tiscene.scene.bvh.obstacle_tree import MeshTrees
from tiscene.scene.camera import Camera
from tiscene.scene.description import Light, SceneDescription, Template
from tiscene.scene.placement import Placement
from tiscene.world.category_ids import CategoryIds
from tiscene.world.edit_lock import one_at_a_time
from tiscene.world.frame_evaluator import FrameEvaluator
from tiscene.world.lights import WorldLights, with_light
from tiscene.world.material_animation import MaterialAnimation
from tiscene.world.object_edits import ObjectEdits
from tiscene.world.object_registry import ObjectRegistry
from tiscene.world.overlap_detector import OverlapDetector
from tiscene.world.overridden_stage import check_materials, overridden, warn_of_own_cameras, with_materials
from tiscene.world.physics_trajectories import PhysicsTrajectories
from tiscene.world.place_finder import PlaceFinder
from tiscene.world.room_finder import RoomFinder
from tiscene.world.stage_objects import StageObjects
from tiscene.world.trajectories import TrajectoryContext
from tiscene.world.view_history import ViewHistory
from tiscene.world.world_cameras import WorldCameras
from tiscene.world.world_parts import WorldParts
from tiscene.world.world_state import CameraStep, ObjectBounds, WorldState


class World(WholeChanges, ObjectEdits):
    """The objects of a stage and of a scenario, on the clock of a stream.

    Instance ids: objects of the stage have 1 to n in the stage's order, objects of the scenario the following ones in
    theirs. Category ids: see CategoryIds.

    A running stream can be edited: `spawn`, `despawn`, `move`, `move_camera` and `turn_camera` take effect at its next
    frame and are kept in `scenario.edits`, so that a world of that scenario has the same states.

    Args:
        scenario: the scenario.
        stage: its stage, as authored.
        load_template: loads a template that the stage does not hold; raises TemplateNotFound.
        fps: frame k shows time k / fps.
        aspect: width / height of the main camera's view, which the frustum's walls enclose.
        trees: returns the bounding volume hierarchies of the stage's meshes, if a renderer has them; requested if
            objects can collide.
        category_ids: assigns the ids of categories; None: 1, 2, ... as they first appear.
        seed: of the search for free places.
        edit_lock: held during an edit; None: edits and states are of one thread.

    Attributes:
        stage: the stage, with the scenario's overrides, and with a light in any case.
        fps: frames per second.
        cameras: the scenario's cameras, else the stage's first, else one that frames the stage.
        next_frame: the frame at which edits take effect.
        start_edits: number of edits that were made at frame 0 since this world was made.

    Raises:
        ScenarioError, CameraNotFound, LightNotFound, ArgumentError: the scenario does not fit the stage.
        MissingExtra: it has rigid bodies, and MuJoCo is not installed.
    """

    def __init__(
        self,
        scenario: Scenario,
        stage: SceneDescription,
        load_template: Callable[[str], Template],
        fps: float,
        aspect: float = 4.0 / 3.0,
        trees: Callable[[], MeshTrees] | None = None,
        category_ids: CategoryIds | None = None,
        seed: int = 0,
        edit_lock: AbstractContextManager[object] | None = None,
    ) -> None:
        self._scenario = scenario
        self.edit_lock = edit_lock or nullcontext()
        self.stage = stage = overridden(stage, scenario.overrides)
        self.fps = argument_checks.positive(fps, "fps")
        self.cameras = tuple(each if isinstance(each, Camera) else stage.camera(each) for each in scenario.cameras)
        warn_of_own_cameras(scenario.cameras, stage, scenario.overrides)
        names = [camera.name for camera in self.cameras]
        if len(set(names)) < len(names):
            raise ScenarioError(f"camera: {', '.join(names)}: two cameras share a name; give each its own")
        self.next_frame = self.start_edits = 0
        self._aspect, self._seed = aspect, seed
        self._edit_count = len(scenario.edits)  # of those that are whole
        self._last_state: WorldState | None = None

        def load(name: str) -> Template:
            template = load_template(name)
            return replace(template, description=with_materials(template.description, scenario.overrides))

        inner = {each.name: each for each in stage.templates}
        used = {each.template for each in scenario.objects}
        self.stage = stage = with_light(stage, [(inner.get(name) or load(name)).description for name in used])
        self._load_template, self._trees = load, trees or (lambda: MeshTrees.built(stage.meshes))
        self._first_category_ids = category_ids or CategoryIds()
        self._made = self._make(scenario)
        check_materials(self.descriptions, scenario.overrides)

    def _make(self, scenario: Scenario, replaced_lights: Mapping[int, Light] = MappingProxyType({})) -> WorldParts:
        """Make everything that depends on the edits of a scenario."""
        log = scenario.log()
        stage, fps, aspect = self.stage, self.fps, self._aspect
        ids = deepcopy(self._first_category_ids)
        registry = ObjectRegistry(stage, self._load_template, ids, log.histories)
        stage_objects = StageObjects(
            stage, registry.stage_rows, registry.stage_owner, registry.stage_tracks, registry.stage_poses, fps
        )
        stage_objects.settle(log.stage_histories)
        lights = WorldLights(stage, scenario.lights)
        for row, light in replaced_lights.items():
            lights.replace_light(row, light)
        setting = TrajectoryContext(
            stage=stage,
            cameras=self.cameras,
            fps=fps,
            aspect=aspect,
            lights=[(motion.dynamic, *pose) for motion, pose in zip(scenario.lights, lights.poses(), strict=True)],
            surface=registry.surface,
            trees=functools.cache(self._trees),
            instances=stage_objects.instances,
        )
        trajectories = PhysicsTrajectories(scenario, log, setting)
        cameras = WorldCameras(self.cameras, log, trajectories, fps, stage.camera_names)
        history = ViewHistory(log, trajectories, cameras, registry.id_of(0), fps, aspect, self.edit_lock)
        overlaps = OverlapDetector(
            log,
            stage,
            registry.surface,
            stage_objects.instances,
            trajectories,
            viewpoint=lambda: cameras.planned_start().current.position,
        )
        animation, rooms = MaterialAnimation(registry.descriptions), RoomFinder(stage.rooms)
        evaluator = FrameEvaluator(log, registry, stage_objects, lights, animation, trajectories, overlaps, fps, rooms)
        finder = PlaceFinder(stage, registry, stage_objects, evaluator, aspect, self._seed)
        return WorldParts(log, registry, stage_objects, lights, trajectories, cameras, history, evaluator, finder)

    @property
    def _parts(self) -> WorldParts:
        """What depends on the edits: made anew, `descriptions` too, if an exception has ended one of them.

        Such an edit, which KeyboardInterrupt can end, is undone.
        """
        if self.is_unfinished:
            with self.edit_lock:  # another thread may do so
                if self.is_unfinished:
                    edits = tuple(self._made.log.edits[: self._edit_count])
                    self._made.trajectories.close()
                    self._made = self._make(replace(self._scenario, edits=edits), self._made.lights.replaced)
                    self._last_state, self.is_unfinished = None, False
        return self._made

    @property
    def scenario(self) -> Scenario:
        """The scenario with all edits so far."""
        edits = self._parts.log.edits
        if len(self._scenario.edits) < len(edits):
            self._scenario = replace(self._scenario, edits=tuple(edits))
        return self._scenario

    @property
    def edit_count(self) -> int:
        """Number of edits so far, at constant cost: `scenario` is made anew after edits."""
        return len(self._parts.log.edits)

    @property
    def replaced_lights(self) -> dict[int, Light]:
        """What `set_light` has put in the place of lights of the stage, by row."""
        return self._parts.lights.replaced

    def edits(self, first: int, last: int) -> list[Edit]:
        """Return edits `first` to `last - 1`, in the order in which they were made."""
        return self._parts.log.edits[first:last]

    @one_at_a_time
    def follow(self, first: int, edits: Sequence[Edit]) -> None:
        """Make edits of another world of the same scenario, except those that this one has made.

        Args:
            first: number of edits that the other world made before.
            edits: what it made then.
        """
        for edit in edits[self.edit_count - first :]:
            self._edit(edit)

    @property
    def trajectories(self) -> PhysicsTrajectories:
        """Poses of objects, cameras and lights."""
        return self._parts.trajectories

    @property
    def view_history(self) -> ViewHistory:
        """From where objects were seen before."""
        return self._parts.view_history

    @property
    def camera(self) -> Camera:
        """The main camera."""
        return self.cameras[0]

    @property
    def templates(self) -> list[str]:
        """Sorted names of the templates that the stage holds or the scenario uses."""
        return sorted(self._parts.registry.templates)

    @property
    def descriptions(self) -> list[SceneDescription]:
        """The stage, then the templates in the order of first use. Mesh rows of placements count through them."""
        return self._parts.registry.descriptions

    @property
    def categories(self) -> dict[int, str]:
        """Names of category ids; 0 is the background."""
        return dict(self.category_ids.names)

    @property
    def category_ids(self) -> CategoryIds:
        """Ids of the categories of all objects so far."""
        return self._parts.registry.category_ids

    @property
    def initial_objects(self) -> list[ObjectState]:
        """The stage's objects as they are authored, before any edit."""
        return list(self._parts.registry.stage_rows)

    def state(self, frame: int) -> WorldState:
        """Compute everything about the world at one frame.

        Args:
            frame: 0 or more.

        Returns:
            The state, a pure function of the scenario with its edits up to `frame`. Edits are not anticipated:
            `placement` at frame + 1 shows what was planned when `frame` was made.

        Raises:
            ArgumentError: for a negative frame.
        """
        frame = argument_checks.integer(frame, "frame", 0)
        parts = self._parts
        if self._last_state is None or self._last_state.frame != frame:
            self._last_state = self._compute_state(parts, frame)
        return self._last_state

    def _compute_state(self, parts: WorldParts, frame: int) -> WorldState:
        evaluator = parts.evaluator
        objects = tuple(evaluator.objects(frame))
        if frame == 0:
            previous = ObjectBounds(tuple(each for each in objects if each.prim_path))
        elif self._last_state is not None and self._last_state.frame == frame - 1:
            previous = self._last_state.bounds
        else:
            previous = ObjectBounds(tuple(evaluator.objects(frame - 1)))
        placement = evaluator.place(frame)
        return WorldState(
            frame=frame,
            aspect=self._aspect,
            cameras=tuple(parts.cameras.step(frame, row) for row in range(len(self.cameras))),
            placement=placement,
            objects=objects,
            lights=self.stage.lights if placement.lights is None else tuple(light for _, light in placement.lights),
            movers=evaluator.movers(frame),
            has_dynamic_lights=evaluator.has_dynamic_lights(frame) or evaluator.materials.varies_stage_emission,
            starting_lights=evaluator.are_starting_lights(frame, placement.light_groups),
            changes=evaluator.changes(frame),
            volumes=self.stage.rooms,
            previous_bounds=previous,
        )

    def between(self, frame: int, shift: Fraction) -> tuple[Placement, tuple[Camera, ...]]:
        """Return the placement and one camera per camera of the world at a time within the shutter interval of a frame.

        Args:
            frame: 0 or more.
            shift: offset from `frame`, in frames, -1..1.
        """
        frame = argument_checks.integer(frame, "frame", 0)
        return self._parts.evaluator.place(frame, shift), self._parts.cameras.between(frame, shift)

    def planned_start(self) -> tuple[Placement, CameraStep]:
        """Return frame 0 and its main camera as if no edit had placed the camera, nor `set_light` replaced a light."""
        authored = replace(self._parts.evaluator, lights=WorldLights(self.stage, self._scenario.lights))
        return authored.place(0), self._parts.cameras.planned_start()

    @one_at_a_time
    def set_light(self, row: int, light: Light) -> None:
        """Replace a light of the stage by another of the same kind, for all frames. Not part of the scenario.

        Raises:
            ArgumentError: there is no such light, or it is of another kind.
        """
        row = argument_checks.integer(row, "row", 0, len(self.stage.lights) - 1)
        authored = self.stage.lights[row]
        if type(light) is not type(authored):
            wanted = f"{type(authored).__name__}, as {authored.prim_path} is"
            raise ArgumentError(f"light is a {type(light).__name__}: must be a {wanted} (see dataclasses.replace)")
        self._replace_light(self._parts, row, light)

    @as_a_whole
    def _replace_light(self, parts: WorldParts, row: int, light: Light) -> None:
        parts.lights.replace_light(row, light)
        parts.evaluator.forget_starting_lights()
        self._last_state = None

    def _edit(self, edit: Edit) -> None:
        parts = self._parts
        parts.view_history.settle(edit.frame)
        parts.log.check(edit)
        self._make_edit(parts, edit)

    @as_a_whole
    def _make_edit(self, parts: WorldParts, edit: Edit) -> None:
        parts.log.add(edit)
        if isinstance(edit, Spawn):
            parts.registry.settle()
        elif isinstance(edit, Move | Despawn) and parts.log.row(edit.id) is None:
            parts.stage_objects.settle(parts.log.stage_histories)
        self._last_state = None
        parts.view_history.forget(edit.frame)
        if not isinstance(edit, PlaceCamera):
            parts.trajectories.amend(edit)
        if edit.frame == 0:
            parts.evaluator.forget_starting_lights()
            self.start_edits += 1
        self._edit_count += 1
