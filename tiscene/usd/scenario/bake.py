# SPDX-License-Identifier: Apache-2.0
"""write_motion: bake a stream's motion into a USD layer over its scene, as time samples that any USD program plays.

Objects, cameras and lights are sampled once per frame; time code k is frame k. `tiscene.usd` does not import
`tiscene.world`: `BakedWorld` and the protocols before it state what is needed of a `World`.
"""

from __future__ import annotations

import itertools
import operator
import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from tiscene.errors import ArgumentError
from tiscene.scene.camera import Camera, Quaternion, Vector3, quaternion_from_matrix
from tiscene.scene.description import Light, SceneDescription
from tiscene.scene.lights.light_groups import emission_of
from tiscene.usd.core import schema
from tiscene.usd.core.pose import PoseOperations, pose_matrix, pose_operations, read_pose
from tiscene.usd.core.stage import quiet, readable, reading_time
from tiscene.usd.scenario.layer import OverLayer
from tiscene.usd.scenario.light_time_samples import write_emission
from tiscene.usd.scenario.name_labels import write_name_labels

Array = NDArray[np.float64]
Poses = dict[int, Array]  # by frame: position (m) and quaternion [7]
Offsets = dict[int, Array]  # by frame: float64 [4, 4], from the authored pose to the current one


class BakedObject(Protocol):
    """A live object at one frame. Attributes as of `tiscene.frame.object_table.ObjectState`."""

    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    @property
    def prim_path(self) -> str: ...
    @property
    def category(self) -> str: ...
    @property
    def position(self) -> Vector3: ...
    @property
    def rotation(self) -> Quaternion: ...


class BakedCamera(Protocol):
    """A camera at one frame."""

    @property
    def current(self) -> Camera: ...


class BakedState(Protocol):
    """A world at one frame: live objects, lights, and one row per camera."""

    @property
    def objects(self) -> Sequence[BakedObject]: ...
    @property
    def lights(self) -> Sequence[Light]: ...
    @property
    def cameras(self) -> Sequence[BakedCamera]: ...


class BakedScenario(Protocol):
    """The scenario of a world: its objects with their edits, and which lights are animated."""

    @property
    def scene(self) -> str: ...
    @property
    def variants(self) -> Mapping[str, str]: ...
    @property
    def lights(self) -> Sequence[Any]:
        """Light motions; `light` is a light's path or name."""

    def log(self) -> Any:
        """Return the edit log: `histories` of the objects, and `stage_histories` by prim path."""


class BakedTrajectories(Protocol):
    """Poses of a world's objects."""

    def arrivals(self, frame: int, rows: Sequence[int]) -> Array:
        """Return the poses [n, 7] of histories of the edit log at a frame, as planned at the frame before."""


class BakedWorld(Protocol):
    """A world that can be baked."""

    @property
    def scenario(self) -> BakedScenario: ...
    @property
    def stage(self) -> SceneDescription: ...
    @property
    def fps(self) -> float: ...
    @property
    def cameras(self) -> Sequence[Camera]: ...
    @property
    def trajectories(self) -> BakedTrajectories: ...
    @property
    def initial_objects(self) -> Sequence[BakedObject]:
        """The stage's objects as authored, before any edit."""

    def state(self, frame: int) -> BakedState: ...


def write_motion(world: BakedWorld, path: str | os.PathLike[str], frames: int | Iterable[int]) -> None:
    """Write the poses, lifespans and lights of some frames of a world as a layer over its scene.

    Objects are references to their templates, with translate and orient in double precision; they are visible while
    they are alive, and have one pose more, which gives their motion at the last frame. Objects of the stage that edits
    have changed, cameras that move or are not on the stage, and animated lights are written too. `read_stage` at time
    code k gives the world of frame k.

    Args:
        world: the world.
        path: file to write (.usda, .usdc, .usd).
        frames: number of frames from 0 on, or their increasing indices. The stage plays `world.fps` frames per second.

    Raises:
        ArgumentError: invalid frames or suffix, or an edited object that is not a prim.
        ExportError: the file cannot be written.
        TisceneError: the scene or a template does not exist any more.
    """
    numbers = _frame_numbers(frames)
    scenario = world.scenario
    with quiet(), readable(os.fspath(path)):
        over = OverLayer(scenario.scene, "Motion", scenario.variants)
        over.set_time(numbers[0], numbers[-1], world.fps)
        recorded = _Recording(world, numbers)
        spawned = _write_objects(over, scenario, recorded, numbers)
        write_name_labels(over, spawned, world.stage.objects)
        _write_edited_stage_objects(over, recorded, numbers)
        _write_lights(over, world, recorded)
        _write_cameras(over, world, recorded)
        over.export(path)


class _Recording:
    """Poses and lights of a world at some frames. Each frame's state is computed once and not kept.

    Attributes:
        objects: poses of the scenario's objects, by name.
        categories: those of the scenario's objects, by name.
        vanished: poses to which objects that vanish were moving, one frame after their last, by name.
        stage_objects: offsets of the stage's objects that edits have changed, by prim path.
        lights: animated lights, by prim path and frame.
        cameras: poses, one row per camera.
        lenses: the cameras whose lenses vary at each frame, by row.
    """

    def __init__(self, world: BakedWorld, frames: Sequence[int]) -> None:
        """Record the frames of a world."""
        initial = {each.prim_path: each for each in world.initial_objects}
        animated = {motion.light for motion in world.scenario.lights}
        paths = [each.prim_path for each in world.stage.lights if animated & {each.prim_path, each.name}]
        self.objects: dict[str, Poses] = {}
        self.categories: dict[str, str] = {}
        self.vanished: dict[str, Poses] = {}
        self.stage_objects: dict[str, Offsets] = {path: {} for path in world.scenario.log().stage_histories}
        self.lights: dict[str, dict[int, Light]] = {path: {} for path in paths}
        self.cameras: list[Poses] = [{} for _ in world.cameras]
        varying = [row for row, camera in enumerate(world.cameras) if camera.lens is not None]
        self.lenses: dict[int, dict[int, Camera]] = {row: {} for row in varying}
        stage_count = len(world.stage.objects)
        for frame in frames:
            state = world.state(frame)
            for each in state.objects:
                if each.id > stage_count:
                    self.objects.setdefault(each.name, {})[frame] = np.array([*each.position, *each.rotation])
                    self.categories[each.name] = each.category
                elif each.prim_path in self.stage_objects:
                    offset = _offset(_matrix(initial[each.prim_path]), _matrix(each))
                    self.stage_objects[each.prim_path][frame] = offset
            for light in state.lights:
                if light.prim_path in self.lights:
                    self.lights[light.prim_path][frame] = light
            for poses, camera in zip(self.cameras, state.cameras, strict=True):
                poses[frame] = np.array([*camera.current.position, *camera.current.rotation])
            for row, lens in self.lenses.items():
                lens[frame] = state.cameras[row].current
        for row, history in enumerate(world.scenario.log().histories):
            poses = self.objects.get(history.spec.id, {})
            for frame, following in itertools.pairwise(frames):
                if frame in poses and following not in poses and history.alive(frame, as_of=frame):
                    (pose,) = world.trajectories.arrivals(frame + 1, (row,))
                    self.vanished.setdefault(history.spec.id, {})[frame + 1] = pose


def _write_objects(
    over: OverLayer, scenario: BakedScenario, recorded: _Recording, frames: Sequence[int]
) -> dict[Usd.Prim, str]:
    """Write the objects of the scenario; return their prims with their categories."""
    specs = {history.spec.id: history.spec for history in scenario.log().histories}
    prims: dict[Usd.Prim, str] = {}
    for spec in specs.values():
        if spec.id not in recorded.objects:
            continue
        scale = np.broadcast_to(spec.scale, 3).tolist()
        prim, operations = over.define_object(spec.id, spec.template, scale=scale)
        prims[prim] = recorded.categories[spec.id]
        if schema.has(prim, schema.MOTION) or schema.has(prim, schema.OBJECT):
            _disable_schema_motion(prim)
        poses = recorded.objects[spec.id]
        moving = sorted((poses | recorded.vanished.get(spec.id, {})).items())
        _write_poses(operations, dict(moving), over)
        _write_visibility(prim, [frame in poses for frame in frames], frames)
    # Streaming this layer plays these objects instead of those that the scene's author animated.
    root = over.stage.GetPrimAtPath(over.root)
    root.AddAppliedSchema(schema.SCENARIO)
    root.CreateRelationship("tiscene:scenario:objects", False).SetTargets([prim.GetPath() for prim in prims])
    return prims


def _disable_schema_motion(prim: Usd.Prim) -> None:
    """Turn off the motion that the scene's author gave a prim by the schema: time samples replace it."""
    boolean, token = Sdf.ValueTypeNames.Bool, Sdf.ValueTypeNames.Token
    prim.CreateAttribute("tiscene:motion:type", token, False, Sdf.VariabilityUniform).Set("none")
    for name in ("collide", "frustumLimited"):
        prim.CreateAttribute(f"tiscene:object:{name}", boolean, False, Sdf.VariabilityUniform).Set(False)


def _write_edited_stage_objects(over: OverLayer, recorded: _Recording, frames: Sequence[int]) -> None:
    for path, offsets in recorded.stage_objects.items():
        prim = _write_offsets(over, path, offsets)
        _write_visibility(prim, [frame in offsets for frame in frames], frames)


def _write_lights(over: OverLayer, world: BakedWorld, recorded: _Recording) -> None:
    """Write the poses and the emission of animated lights where they differ from the scene's."""
    authored = {light.prim_path: light for light in world.stage.lights}
    for path, lights in recorded.lights.items():
        start = authored[path]
        offsets = {frame: _offset(start.world_from_light, light.world_from_light) for frame, light in lights.items()}
        prim = over.editable(path)
        if any(not np.array_equal(offset, np.eye(4)) for offset in offsets.values()):
            prim = _write_offsets(over, path, offsets)
        if any(emission_of(light) != emission_of(start) for light in lights.values()):
            write_emission(prim, {frame: emission_of(light) for frame, light in lights.items()})


def _write_offsets(over: OverLayer, path: str, offsets: Offsets) -> Usd.Prim:
    """Write the poses of a prim of the scene, given relative to its authored pose.

    Raises ArgumentError for a path that is not a transformable prim, such as one point of an instancer.
    """
    prim = over.editable(path)
    start = read_pose(prim, reading_time(over.stage, None), over.units) if prim else "it is not a prim of its own"
    if prim is None or isinstance(start, str):
        raise ArgumentError(f"the motion of {path!r} cannot be written: {start}")
    authored = pose_matrix(start.position, start.rotation)
    poses = {}
    for frame, offset in offsets.items():
        matrix = offset @ authored if not np.array_equal(offset, np.eye(4)) else authored
        poses[frame] = np.array([*matrix[:3, 3], *quaternion_from_matrix(matrix[:3, :3])])
    operations = pose_operations(prim, euler=False, scale=start.scale, stretch=start.stretch)
    UsdGeom.Xformable(prim).SetResetXformStack(True)  # the pose is that in the world
    if poses:
        _write_poses(operations, poses, over)
    return prim


def _matrix(each: BakedObject) -> Array:
    return pose_matrix(each.position, each.rotation)


def _offset(start: Array, current: Array) -> Array:
    """Return the 4x4 from one pose to another; exactly the identity if they are equal."""
    return np.eye(4) if np.array_equal(start, current) else current @ np.linalg.inv(start)


def _write_cameras(over: OverLayer, world: BakedWorld, recorded: _Recording) -> None:
    """Write the cameras of the world, except for static ones of the stage."""
    paths = []
    on_stage = {name: path for path, name in world.stage.camera_names.items()}
    for row, (camera, poses) in enumerate(zip(world.cameras, recorded.cameras, strict=True)):
        lenses = recorded.lenses.get(row, {})
        if camera.dynamic is None and not lenses and camera in world.stage.cameras:
            if camera.name in on_stage:
                paths.append(Sdf.Path(on_stage[camera.name]))
            continue
        prim, operations = over.define_camera(next(iter(lenses.values()), camera))
        paths.append(prim.GetPath())
        _write_poses(operations, poses, over)
        over.write_lens(prim, lenses)
    if len(paths) > 1 or any(path.HasPrefix(over.root) for path in paths):
        root = over.stage.GetPrimAtPath(over.root)
        root.CreateRelationship("tiscene:scenario:camera", False).SetTargets(paths)


def _write_poses(operations: PoseOperations, poses: Poses, over: OverLayer) -> None:
    """Write one value for a static pose, else a sample per frame.

    USD interpolates quaternions by components: consecutive ones are kept in the same hemisphere.
    """
    first = next(iter(poses.values()))
    if all(np.array_equal(pose, first) for pose in poses.values()):
        operations.set(first[:3].tolist(), first[3:].tolist(), over.units)
        return
    last = first[3:]
    for frame, pose in poses.items():
        last = -pose[3:] if pose[3:] @ last < 0.0 else pose[3:]
        operations.set(pose[:3].tolist(), last.tolist(), over.units, Usd.TimeCode(frame))


def _write_visibility(prim: Usd.Prim, alive: Sequence[bool], frames: Sequence[int]) -> None:
    """Write a sample wherever visibility changes: USD holds it until the next sample."""
    visibility = UsdGeom.Imageable(prim).CreateVisibilityAttr()
    tokens = [UsdGeom.Tokens.inherited if each else UsdGeom.Tokens.invisible for each in alive]
    if len(set(tokens)) == 1:
        visibility.Set(tokens[0])
        return
    for row, (frame, token) in enumerate(zip(frames, tokens, strict=True)):
        if row == 0 or token != tokens[row - 1]:
            visibility.Set(token, Usd.TimeCode(frame))


def _frame_numbers(frames: int | Iterable[int]) -> list[int]:
    """Return the indices of frames. Raises ArgumentError unless they are integers, 0 or more, increasing, not empty."""
    try:
        numbers = [operator.index(each) for each in frames] if isinstance(frames, Iterable) else list(range(frames))
    except TypeError:
        raise ArgumentError(f"frames={frames!r}: must be a number of frames, or the indices of frames") from None
    if not numbers or numbers[0] < 0 or any(b <= a for a, b in itertools.pairwise(numbers)):
        raise ArgumentError(f"frames={frames!r}: must be at least one frame, 0 or more, and increasing")
    return numbers
