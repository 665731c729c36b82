"""A stream's motion as a USD layer over its scene: time samples of poses and visibility, for any USD program."""

from __future__ import annotations

import itertools
import operator
import os
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from tiscene.errors import ArgumentError
from tiscene.usd import schema
from tiscene.usd.author import OverLayer
from tiscene.usd.pose import PoseOperations
from tiscene.usd.stage import quiet, readable

if TYPE_CHECKING:
    from tiscene.world import World

Array = NDArray[np.float64]


def write_motion(world: World, path: str | os.PathLike[str], frames: int | Iterable[int]) -> None:
    """Write where everything is at some frames of a world as a layer (.usda, .usdc, .usd) over its scene.

    frames: how many, from 0 on; or their numbers. Time code k is frame k, and the stage plays fps of them a second.
    Objects are references to their templates, with translate and orient in double precision, and are visible while they
    are alive; a camera that moves or that is not on the stage is written too. `read_stage` at a time code gives the
    world of that frame.
    Raises ArgumentError (frames, suffix), ExportError, and what is raised for scenes and templates that are gone.
    """
    numbers = _frame_numbers(frames)
    with quiet(), readable(os.fspath(path)):
        over = OverLayer(world.scenario.scene, "Motion")
        over.set_time(numbers[0], numbers[-1], world.fps)
        _write_objects(over, world, numbers)
        _write_camera(over, world, numbers)
        over.export(path)


def _write_objects(over: OverLayer, world: World, frames: Sequence[int]) -> None:
    standing = len(world.stage.objects)
    asked = {life.planned.id: life.planned for life in world.scenario.lives()}
    poses: dict[str, dict[int, Array]] = {}
    for frame in frames:
        for row in world.objects(frame):
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


def _write_camera(over: OverLayer, world: World, frames: Sequence[int]) -> None:
    """The camera, unless it is one of the stage's that stands still."""
    if world.camera.dynamic is None and world.camera in world.stage.cameras:
        return
    prim, operations = over.define_camera(world.camera)
    root = over.stage.GetPrimAtPath(over.root)
    root.CreateRelationship("tiscene:scenario:camera", False).SetTargets([prim.GetPath()])
    cameras = [world.view(frame)[1] for frame in frames]
    poses = [np.array([*camera.position, *camera.rotation]) for camera in cameras]
    _write_poses(operations, dict(zip(frames, poses, strict=True)), over)


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
