# SPDX-License-Identifier: Apache-2.0
"""write_motion: bake recorded motion into a USD layer over its scene, as time samples that any USD program plays.

Objects, cameras and lights have a sample per frame; time code k is frame k.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdSemantics

from tiscene.errors import ArgumentError
from tiscene.scene.camera import Camera, Vector3, quaternion_from_matrix
from tiscene.scene.description import Light, SceneDescription, SceneObject
from tiscene.scene.lights.light_groups import emission_of
from tiscene.usd.core import schema
from tiscene.usd.core.pose import PoseOperations, pose_matrix, pose_operations, read_pose
from tiscene.usd.core.semantics import PREFERRED_TAXONOMIES, direct_label, inherited_label, name_label, taxonomies_of
from tiscene.usd.core.stage import quiet, readable, reading_time
from tiscene.usd.scenario.layer import OverLayer
from tiscene.usd.scenario.light_time_samples import write_emission

Array = NDArray[np.float64]
Poses = dict[int, Array]  # by frame: position (m) and quaternion [7]
Offsets = dict[int, Array]  # by frame: float64 [4, 4], from the authored pose to the current one


@dataclass(eq=False)
class RecordedObject:
    """An object of a scenario.

    Attributes:
        template: name or file of its template.
        scale: factors along its axes; one for all.
        category: its category.
        poses: while it is alive.
        vanished: poses to which it was moving where it vanishes, one frame after its last.
    """

    template: str
    scale: float | Vector3
    category: str
    poses: Poses
    vanished: Poses = field(default_factory=dict)


@dataclass(eq=False)
class RecordedMotion:
    """Poses and lights of a world at some frames.

    Attributes:
        scene: name or file of the scene.
        variants: selected on it.
        stage: the scene as authored.
        fps: frames per second.
        frames: the frames, increasing.
        objects: the scenario's objects, by name.
        stage_objects: offsets of the stage's objects that edits have changed, by prim path.
        lights: animated lights, by prim path and frame.
        cameras: the world's cameras.
        camera_poses: their poses, one row per camera.
        lenses: the cameras whose lenses vary at each frame, by row.
    """

    scene: str
    variants: Mapping[str, str]
    stage: SceneDescription
    fps: float
    frames: Sequence[int]
    objects: dict[str, RecordedObject]
    stage_objects: dict[str, Offsets]
    lights: dict[str, dict[int, Light]]
    cameras: Sequence[Camera]
    camera_poses: list[Poses]
    lenses: dict[int, dict[int, Camera]]


def write_motion(motion: RecordedMotion, path: str | os.PathLike[str]) -> None:
    """Write recorded motion as a layer over its scene.

    Objects are references to their templates, with translate and orient in double precision; they are visible while
    they are alive, and have one pose more, which gives their motion at the last frame. Objects of the stage that edits
    have changed, cameras that move or are not on the stage, and animated lights are written too. `read_stage` at time
    code k gives the world of frame k. The stage plays `motion.fps` frames per second.

    Args:
        motion: what to write.
        path: file to write (.usda, .usdc, .usd).

    Raises:
        ArgumentError: an invalid suffix, or an edited object that is not a prim.
        ExportError: the file cannot be written.
        TisceneError: the scene or a template does not exist any more.
    """
    with quiet(), readable(os.fspath(path)):
        over = OverLayer(motion.scene, "Motion", motion.variants)
        over.set_time(motion.frames[0], motion.frames[-1], motion.fps)
        spawned = _write_objects(over, motion)
        _write_name_labels(over, spawned, motion.stage.objects)
        for prim_path, offsets in motion.stage_objects.items():
            prim = _write_offsets(over, prim_path, offsets)
            _write_visibility(prim, offsets, motion.frames)
        _write_lights(over, motion)
        _write_cameras(over, motion)
        over.export(path)


def _write_objects(over: OverLayer, motion: RecordedMotion) -> dict[Usd.Prim, str]:
    """Write the objects of the scenario; return their prims with their categories."""
    prims: dict[Usd.Prim, str] = {}
    for name, each in motion.objects.items():
        prim, operations = over.define_object(name, each.template, scale=np.broadcast_to(each.scale, 3).tolist())
        prims[prim] = each.category
        if schema.has(prim, schema.OBJECT, schema.MOTION):
            _disable_schema_motion(prim)
        _write_poses(operations, dict(sorted((each.poses | each.vanished).items())), over)
        _write_visibility(prim, each.poses, motion.frames)
    # Streaming this layer plays these objects instead of those that the scene's author animated.
    root = over.stage.GetPrimAtPath(over.root)
    root.AddAppliedSchema(schema.SCENARIO)
    root.CreateRelationship("tiscene:scenario:objects", False).SetTargets([prim.GetPath() for prim in prims])
    return prims


def _disable_schema_motion(prim: Usd.Prim) -> None:
    """Turn off the motion that the scene's author gave a prim by the schema: time samples replace it."""
    for name, value in (("motion:type", "none"), ("object:collide", False), ("object:frustumLimited", False)):
        schema.author(prim, f"tiscene:{name}", value)


def _write_lights(over: OverLayer, motion: RecordedMotion) -> None:
    """Write the poses and the emission of animated lights where they differ from the scene's."""
    authored = {light.prim_path: light for light in motion.stage.lights}
    for path, lights in motion.lights.items():
        start = authored[path]
        offsets = {frame: offset(start.world_from_light, light.world_from_light) for frame, light in lights.items()}
        prim = over.editable(path)
        if any(not np.array_equal(each, np.eye(4)) for each in offsets.values()):
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
    for frame, each in offsets.items():
        matrix = each @ authored if not np.array_equal(each, np.eye(4)) else authored
        poses[frame] = np.array([*matrix[:3, 3], *quaternion_from_matrix(matrix[:3, :3])])
    operations = pose_operations(prim, euler=False, scale=start.scale, stretch=start.stretch)
    UsdGeom.Xformable(prim).SetResetXformStack(True)  # the pose is that in the world
    if poses:
        _write_poses(operations, poses, over)
    return prim


def offset(start: Array, current: Array) -> Array:
    """Return the 4x4 from one pose to another; exactly the identity if they are equal."""
    return np.eye(4) if np.array_equal(start, current) else current @ np.linalg.inv(start)


def _write_cameras(over: OverLayer, motion: RecordedMotion) -> None:
    """Write the cameras of the world, except for static ones of the stage."""
    paths = []
    on_stage = {name: path for path, name in motion.stage.camera_names.items()}
    for row, (camera, poses) in enumerate(zip(motion.cameras, motion.camera_poses, strict=True)):
        lenses = motion.lenses.get(row, {})
        if camera.dynamic is None and not lenses and camera in motion.stage.cameras:
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


def _write_visibility(prim: Usd.Prim, alive: Collection[int], frames: Sequence[int]) -> None:
    """Write a sample of a prim, alive at some of the frames, wherever that changes: USD holds it until the next one."""
    visibility = UsdGeom.Imageable(prim).CreateVisibilityAttr()
    tokens = [UsdGeom.Tokens.inherited if frame in alive else UsdGeom.Tokens.invisible for frame in frames]
    if len(set(tokens)) == 1:
        visibility.Set(tokens[0])
        return
    for row, (frame, token) in enumerate(zip(frames, tokens, strict=True)):
        if row == 0 or token != tokens[row - 1]:
            visibility.Set(token, Usd.TimeCode(frame))


def _write_name_labels(over: OverLayer, spawned: Mapping[Usd.Prim, str], stage_objects: Iterable[SceneObject]) -> None:
    """Label the objects of a layer that have no label, where their names do not give their categories any more.

    Args:
        over: the layer.
        spawned: categories of the prims that the layer adds.
        stage_objects: the objects of the scene.
    """
    unlabeled = {prim: category for prim, category in spawned.items() if category and not _is_labeled(prim)}
    if not taxonomies_of(over.stage) and all(name_label(prim) == name for prim, name in unlabeled.items()):
        return
    for prim, category in unlabeled.items():
        _label(prim, category)
    scene = over.below
    if taxonomies_of(scene):
        return
    points = dict.fromkeys(each.prim_path.partition("[")[0] for each in stage_objects if "[" in each.prim_path)
    for instancer in points:
        for target in UsdGeom.PointInstancer(scene.GetPrimAtPath(instancer)).GetPrototypesRel().GetTargets():
            _label(over.editable(str(target)), name_label(scene.GetPrimAtPath(target)))
    for each in stage_objects:
        if "[" not in each.prim_path:
            _label(over.editable(each.prim_path), each.category)


def _is_labeled(prim: Usd.Prim) -> bool:
    time = reading_time(prim.GetStage(), None)
    if inherited_label(prim, time, None):
        return True
    return any(direct_label(each, time, None) for each in Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))


def _label(prim: Usd.Prim | None, category: str) -> None:
    if prim and category:
        UsdSemantics.LabelsAPI.Apply(prim, PREFERRED_TAXONOMIES[0]).CreateLabelsAttr([category])
