# SPDX-License-Identifier: Apache-2.0
"""A stream's motion as a USD layer over its scene: time samples of poses and visibility, for any USD program."""

from __future__ import annotations

import itertools
import operator
import os
from collections.abc import Iterable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from tiscene.errors import ArgumentError
from tiscene.scene.camera import Camera, Quaternion, Vector3, quaternion_from_matrix
from tiscene.scene.description import Light, SceneDescription
from tiscene.usd.core import schema
from tiscene.usd.core.pose import PoseOperations, pose_matrix, pose_operations, read_pose
from tiscene.usd.core.stage import quiet, readable, reading_time
from tiscene.usd.scenario.layer import OverLayer
from tiscene.usd.scenario.light_time_samples import emitted, write_emission

Array = NDArray[np.float64]


class Posed(Protocol):
    """An object at one frame: rows of `World.objects`."""

    @property
    def id(self) -> int: ...
    @property
    def name(self) -> str: ...
    @property
    def prim_path(self) -> str: ...
    @property
    def position(self) -> Vector3: ...
    @property
    def rotation(self) -> Quaternion: ...


class State(Protocol):
    """A world at one frame."""

    @property
    def objects(self) -> Sequence[Posed]: ...
    @property
    def lights(self) -> Sequence[Light]: ...
    @property
    def cameras(self) -> Sequence[tuple[Camera, Camera, Camera]]: ...


class Motion(Protocol):
    """What is written of a world: its scenario, and where everything is at each frame."""

    @property
    def scenario(self) -> Any:
        """A Scenario."""

    @property
    def stage(self) -> SceneDescription: ...
    @property
    def fps(self) -> float: ...
    @property
    def cameras(self) -> Sequence[Camera]: ...
    @property
    def initial_objects(self) -> Sequence[Posed]: ...
    def state(self, frame: int) -> State: ...


def write_motion(world: Motion, path: str | os.PathLike[str], frames: int | Iterable[int]) -> None:
    """Write where everything is at some frames of a world as a layer (.usda, .usdc, .usd) over its scene.

    frames: how many, from 0 on; or their numbers. Time code k is frame k, and the stage plays fps of them a second.
    Objects are references to their templates, with translate and orient in double precision, and are visible while they
    are alive; so are things of the stage that edits have moved or taken away. Cameras that move or that are not on the
    stage, and lights that move or change, are written too. `read_stage` at a time code gives the world of that frame.
    Raises ArgumentError (frames, suffix), ExportError, and what is raised for scenes and templates that are gone.
    """
    numbers = _frame_numbers(frames)
    with quiet(), readable(os.fspath(path)):
        over = OverLayer(world.scenario.scene, "Motion")
        over.set_time(numbers[0], numbers[-1], world.fps)
        _write_objects(over, world, numbers)
        _write_things(over, world, numbers)
        _write_lights(over, world, numbers)
        _write_cameras(over, world, numbers)
        over.export(path)


def _write_objects(over: OverLayer, world: Motion, frames: Sequence[int]) -> None:
    standing = len(world.stage.objects)
    asked = {life.spec.id: life.spec for life in world.scenario.lives()}
    poses: dict[str, dict[int, Array]] = {}
    for frame in frames:
        for row in world.state(frame).objects:
            if row.id > standing:
                poses.setdefault(row.name, {})[frame] = np.array([*row.position, *row.rotation])
    prims = []
    for each in asked.values():
        if each.id not in poses:
            continue
        prim, operations = over.define_object(each.id, each.template, scale=_three(each.scale))
        prims.append(prim.GetPath())
        if schema.has(prim, schema.MOTION) or schema.has(prim, schema.OBJECT):
            _play_samples(prim)
        alive = poses[each.id]
        _write_poses(operations, alive, over)
        _write_visibility(prim, [frame in alive for frame in frames], frames)
    # Whoever streams this file plays these, and not what the scene's author meant to move.
    root = over.stage.GetPrimAtPath(over.root)
    root.AddAppliedSchema(schema.SCENARIO)
    root.CreateRelationship("tiscene:scenario:objects", False).SetTargets(prims)


def _play_samples(prim: Usd.Prim) -> None:
    """A prim of the scene has a motion by its author already: here its time samples take the place of that."""
    boolean, token = Sdf.ValueTypeNames.Bool, Sdf.ValueTypeNames.Token
    prim.CreateAttribute("tiscene:motion:type", token, False, Sdf.VariabilityUniform).Set("none")
    for name in ("collide", "frustumLimited"):
        prim.CreateAttribute(f"tiscene:object:{name}", boolean, False, Sdf.VariabilityUniform).Set(False)


def _write_things(over: OverLayer, world: Motion, frames: Sequence[int]) -> None:
    """Where things of the stage are that edits have moved or taken away."""
    initial_objects = {row.prim_path: row for row in world.initial_objects}
    for path in world.scenario.stage_lives():
        start = initial_objects[path]
        moved: dict[int, Array] = {}
        for frame in frames:
            for row in world.state(frame).objects:
                if row.prim_path == path:
                    moved[frame] = _between(_placed(start), _placed(row))
        prim = _write_moved(over, path, moved)
        if prim:
            _write_visibility(prim, [frame in moved for frame in frames], frames)


def _write_lights(over: OverLayer, world: Motion, frames: Sequence[int]) -> None:
    """Lights with motions: their poses, and what they emit."""
    first = {light.prim_path: light for light in world.stage.lights}
    if not world.scenario.lights:
        return
    by_frame = {frame: {light.prim_path: light for light in world.state(frame).lights} for frame in frames}
    wanted = {motion.light for motion in world.scenario.lights}
    for path, start in first.items():
        if not wanted & {path, start.name}:
            continue
        lights = {frame: lights[path] for frame, lights in by_frame.items() if path in lights}
        moved = {frame: _between(start.world_from_light, light.world_from_light) for frame, light in lights.items()}
        prim = over.stage.GetPrimAtPath(path)
        if any(not np.array_equal(by, np.eye(4)) for by in moved.values()):
            prim = _write_moved(over, path, moved)
        if any(emitted(light) != emitted(start) for light in lights.values()):
            write_emission(prim, {frame: emitted(light) for frame, light in lights.items()})


def _write_moved(over: OverLayer, path: str, moved: dict[int, Array]) -> Usd.Prim | None:
    """A prim of the scene elsewhere: by frame, what takes it there from where the scene has it, 4x4.

    Raises ArgumentError for what cannot be pose_matrix, such as one point of an instancer.
    """
    prim = over.stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    start = read_pose(prim, reading_time(over.stage, None), over.units) if prim else "it is no prim of its own"
    if prim is None or isinstance(start, str):
        raise ArgumentError(f"what {path!r} does cannot be written: {start}")
    matrix = pose_matrix(start.position, start.rotation)
    poses = {}
    for frame, by in moved.items():
        now = by @ matrix if not np.array_equal(by, np.eye(4)) else matrix
        poses[frame] = np.array([*now[:3, 3], *quaternion_from_matrix(now[:3, :3])])
    operations = pose_operations(prim, euler=False, scale=start.scale, stretch=start.stretch)
    # Nothing above moves it any more.
    UsdGeom.Xformable(prim).SetResetXformStack(True)
    if poses:
        _write_poses(operations, poses, over)
    return prim


def _placed(row: Posed) -> Array:
    return pose_matrix(row.position, row.rotation)


def _between(start: Array, now: Array) -> Array:
    """What leads from one pose to another, 4x4; the identity, to the bit, where nothing has changed."""
    return np.eye(4) if np.array_equal(start, now) else now @ np.linalg.inv(start)


def _write_cameras(over: OverLayer, world: Motion, frames: Sequence[int]) -> None:
    """The cameras that watch: new ones, unless they are the stage's and stand still."""
    paths = []
    on_stage = {prim.GetName(): prim for prim in over.stage.Traverse() if prim.IsA(UsdGeom.Camera)}
    for row, camera in enumerate(world.cameras):
        if camera.dynamic is None and camera in world.stage.cameras:
            if camera.name in on_stage:
                paths.append(on_stage[camera.name].GetPath())
            continue
        prim, operations = over.define_camera(camera)
        paths.append(prim.GetPath())
        views = [world.state(frame).cameras[row][1] for frame in frames]
        poses = [np.array([*view.position, *view.rotation]) for view in views]
        _write_poses(operations, dict(zip(frames, poses, strict=True)), over)
    if len(paths) > 1 or world.cameras[0].dynamic is not None or world.cameras[0] not in world.stage.cameras:
        root = over.stage.GetPrimAtPath(over.root)
        root.CreateRelationship("tiscene:scenario:camera", False).SetTargets(paths)


def _write_poses(operations: PoseOperations, poses: dict[int, Array], over: OverLayer) -> None:
    """One value if it never changes, else a sample a frame. Quaternions stay on one side, for USD interpolates them."""
    first = next(iter(poses.values()))
    if all(np.array_equal(pose, first) for pose in poses.values()):
        operations.set(first[:3].tolist(), first[3:].tolist(), over.units)
        return
    last = first[3:]
    for frame, pose in poses.items():
        last = -pose[3:] if pose[3:] @ last < 0.0 else pose[3:]
        operations.set(pose[:3].tolist(), last.tolist(), over.units, Usd.TimeCode(frame))


def _write_visibility(prim: Usd.Prim, alive: Sequence[bool], frames: Sequence[int]) -> None:
    """Visibility is held until its next sample: one where it changes will do."""
    visibility = UsdGeom.Imageable(prim).CreateVisibilityAttr()
    names = [UsdGeom.Tokens.inherited if each else UsdGeom.Tokens.invisible for each in alive]
    if len(set(names)) == 1:
        visibility.Set(names[0])
        return
    for row, (frame, name) in enumerate(zip(frames, names, strict=True)):
        if row == 0 or name != names[row - 1]:
            visibility.Set(name, Usd.TimeCode(frame))


def _frame_numbers(frames: int | Iterable[int]) -> list[int]:
    try:
        numbers = [operator.index(each) for each in frames] if isinstance(frames, Iterable) else list(range(frames))
    except TypeError:
        raise ArgumentError(f"frames={frames!r}: must be a number of frames, or whole numbers of frames") from None
    if not numbers or numbers[0] < 0 or any(b <= a for a, b in itertools.pairwise(numbers)):
        raise ArgumentError(f"frames={frames!r}: must be one frame or more, from 0 on and increasing")
    return numbers


def _three(scale: float | Sequence[float]) -> tuple[float, float, float]:
    x, y, z = np.broadcast_to(scale, 3).tolist()
    return (x, y, z)
