# SPDX-License-Identifier: Apache-2.0
"""Apply a scenario's overrides to the description of its stage, and to those of templates."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from dynamics.rotation import matrix_from_quaternion, quaternion
from tiscene.errors import MaterialNotFound, ObjectNotFound, ScenarioError, StageWarning
from tiscene.scenario.overrides import CameraOverride, LightOverride, MaterialOverride, ObjectOverride, Override
from tiscene.scene.animation import ColorTrack
from tiscene.scene.assembly import object_matrices, rigid
from tiscene.scene.camera import Camera
from tiscene.scene.description import Instance, Light, Material, SceneDescription, TextureLookup
from tiscene.scene.input_track import InputTrack
from tiscene.scene.lights.light_groups import emission_of, with_emission
from tiscene.world.lights import light_row

Array = NDArray[np.float64]


class _Prim(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def prim_path(self) -> str: ...


AnyPrim = TypeVar("AnyPrim", bound=_Prim)
AnyInstance = TypeVar("AnyInstance", bound=Instance)


def overridden(stage: SceneDescription, overrides: Sequence[Override]) -> SceneDescription:
    """Return a stage with overrides. Overrides of materials that it does not have are left to its templates.

    Args:
        stage: the stage as authored.
        overrides: the overrides.

    Raises:
        LightNotFound, ObjectNotFound, CameraNotFound: an override names a prim that the stage does not have.
        MaterialNotFound: a `like` that it does not have.
        ScenarioError: an animated object is placed elsewhere, or two overrides are of one prim.
    """
    if not overrides:
        return stage
    lights, cameras = list(stage.lights), list(stage.cameras)
    changed: dict[tuple[type, str], str] = {}
    for each in overrides:
        if isinstance(each, LightOverride):
            row = light_row(stage, each.prim)
            _only(each, stage.lights[row].prim_path, changed)
            lights[row] = _lit(lights[row], each, np.asarray(stage.up))
        elif isinstance(each, CameraOverride):
            camera = stage.camera(each.prim or None)
            _only(each, camera.name, changed)
            if camera in stage.cameras:
                cameras[stage.cameras.index(camera)] = _seen(camera, each)
            else:  # of a stage without cameras
                cameras = [_seen(camera, each)]
    light_tracks = [
        each if lights[each.row] is stage.lights[each.row] else each.without(("radiance", "irradiance"))
        for each in stage.light_tracks
    ]
    varying = tuple(each for each in light_tracks if each is not None)
    stage = replace(stage, lights=tuple(lights), light_tracks=varying, cameras=tuple(cameras))
    for each in overrides:
        if isinstance(each, ObjectOverride):
            stage = _arranged(stage, each, changed)
    templates = tuple(
        replace(each, description=with_materials(each.description, overrides)) for each in stage.templates
    )
    return replace(with_materials(stage, overrides), templates=templates)


def with_materials(description: SceneDescription, overrides: Sequence[Override]) -> SceneDescription:
    """Return a stage or template with the overrides of those materials that it has.

    Raises:
        MaterialNotFound: it has an overridden material, but not the one that this should be like.
    """
    materials = list(description.materials)
    for each in overrides:
        row = _row(description.materials, each.prim) if isinstance(each, MaterialOverride) else None
        if row is not None:
            assert isinstance(each, MaterialOverride)
            materials[row] = _painted(materials[row], each, description)
    if materials == list(description.materials):
        return description
    return replace(
        description, materials=tuple(materials), material_tracks=_kept_tracks(description, overrides, materials)
    )


def _kept_tracks(
    description: SceneDescription, overrides: Sequence[Override], materials: Sequence[Material]
) -> tuple[InputTrack, ...]:
    """Return the tracks of a description's materials without the inputs that overrides replace."""
    rows = {
        row: each
        for each in overrides
        if isinstance(each, MaterialOverride) and (row := _row(description.materials, each.prim)) is not None
    }
    kept = []
    for track in description.material_tracks:
        override = rows.get(track.row)
        if override is not None and override.like is not None:
            continue
        before, after = description.materials[track.row], materials[track.row]
        names = [field.name for field in fields(before) if getattr(before, field.name) != getattr(after, field.name)]
        rest = track.without(names)
        kept += [] if rest is None else [rest]
    return tuple(kept)


def check_materials(descriptions: Sequence[SceneDescription], overrides: Sequence[Override]) -> None:
    """Check that each overridden material is in one of the descriptions.

    Raises:
        MaterialNotFound: one is not.
    """
    for each in overrides:
        if isinstance(each, MaterialOverride):
            found = [_row(description.materials, each.prim) for description in descriptions]
            if all(row is None for row in found):
                known = [material.prim_path for one in descriptions for material in one.materials if material.prim_path]
                raise MaterialNotFound("material", each.prim, known, " on the stage or in a template of the scenario")


def warn_of_own_cameras(
    cameras: Sequence[Camera | str | None], stage: SceneDescription, overrides: Sequence[Override]
) -> None:
    """Warn of overrides of cameras that the scenario replaces by its own, such as those that move on the stage."""
    own = {each.name for each in cameras if isinstance(each, Camera)}
    for each in overrides:
        if isinstance(each, CameraOverride) and (name := stage.camera(each.prim or None).name) in own:
            text = (
                f"overrides: the camera {name!r} is one of the scenario's own (one that moves on the stage is read as "
                "such), which no override changes. Change the scenario's `camera` by dataclasses.replace."
            )
            warnings.warn(StageWarning(text), stacklevel=3)


def _row(prims: Sequence[AnyPrim], name: str) -> int | None:
    """Return the row of the prim with a path, else of the first one with a name."""
    for key in ("prim_path", "name"):
        for row, each in enumerate(prims):
            if getattr(each, key) == name:
                return row
    return None


def _only(
    override: LightOverride | ObjectOverride | CameraOverride, path: str, changed: dict[tuple[type, str], str]
) -> None:
    """Note that an override changes a prim. Raises ScenarioError if another one, which names it otherwise, does."""
    other = changed.setdefault((type(override), path), override.prim)
    if other != override.prim:
        kind = type(override).__name__
        raise ScenarioError(f"overrides: two {kind}s of {path!r}: {other!r} and {override.prim!r}; give one")


def _lit(light: Light, override: LightOverride, up: Array) -> Light:
    """Return a light with its override."""
    emission = [each * override.intensity * tint for each, tint in zip(emission_of(light), override.color, strict=True)]
    red, green, blue = emission
    light = with_emission(light, (red, green, blue))
    if override.pitch == 0.0 and override.yaw == 0.0:
        return light
    pose = light.world_from_light.copy()
    half = 0.5 * math.radians(override.yaw)
    turn = matrix_from_quaternion(np.array([math.cos(half), *(math.sin(half) * up)]))
    tilt = matrix_from_quaternion(quaternion((override.pitch, 0.0, 0.0)))
    pose[:3, :3] = np.einsum("ij,jk,kl->il", turn, pose[:3, :3], tilt)
    return replace(light, world_from_light=pose)


def _seen(camera: Camera, override: CameraOverride) -> Camera:
    """Return a camera with its override."""
    names = ("position", "vertical_fov", "lens_radius", "focus_distance")
    given = {name: value for name in names if (value := getattr(override, name)) is not None}
    if override.rotation is not None:
        given["rotation"] = tuple(quaternion(override.rotation).tolist())
    return camera.fixed(**given)


def _arranged(
    stage: SceneDescription, override: ObjectOverride, changed: dict[tuple[type, str], str]
) -> SceneDescription:
    """Return a stage with one object elsewhere, or left out."""
    number = _row(stage.objects, override.prim)
    if number is None:
        raise ObjectNotFound(
            "object", override.prim, [each.prim_path for each in stage.objects], f" in scene {stage.name!r}"
        )
    own = np.array([each.object == number for each in stage.instances], np.bool_)
    path = stage.objects[number].prim_path
    _only(override, path, changed)
    if any(own[track.instances].any() for track in stage.tracks) or any(
        number in track.instances for track in stage.object_tracks
    ):
        raise ScenarioError(f"overrides: the object {path!r} is animated by the stage; move it with an edit")
    if not override.visible:
        return _without(stage, number, own)
    if not own.any() or (override.position is None and override.rotation is None):
        return stage
    authored = object_matrices(stage)[number]
    start = rigid(authored)
    pose = start.copy()
    if override.position is not None:
        pose[:3, 3] = override.position
    if override.rotation is not None:
        pose[:3, :3] = matrix_from_quaternion(quaternion(override.rotation))
    by = np.einsum("ij,jk->ik", pose, np.linalg.inv(start))
    placed = replace(stage.objects[number], world_from_object=np.einsum("ij,jk->ik", by, authored))

    def moved(each: AnyInstance) -> AnyInstance:
        if each.object != number:
            return each
        return replace(each, world_from_object=np.einsum("ij,jk->ik", by, each.world_from_object))

    def carried(light: Light) -> Light:
        if not light.prim_path.startswith(f"{path}/"):
            return light
        return replace(light, world_from_light=np.einsum("ij,jk->ik", by, light.world_from_light))

    return replace(
        stage,
        instances=tuple(map(moved, stage.instances)),
        objects=(*stage.objects[:number], placed, *stage.objects[number + 1 :]),
        colliders=tuple(map(moved, stage.colliders)),
        lights=tuple(map(carried, stage.lights)),
    )


def _without(stage: SceneDescription, number: int, own: NDArray[np.bool_]) -> SceneDescription:
    """Return a stage without the instances, colliders and lights of an object, which keeps its row."""
    rows = np.cumsum(~own) - 1
    path = stage.objects[number].prim_path
    left = [row for row, each in enumerate(stage.lights) if not each.prim_path.startswith(f"{path}/")]
    light_tracks = [replace(each, row=left.index(each.row)) for each in stage.light_tracks if each.row in left]
    return replace(
        stage,
        instances=tuple(each for each in stage.instances if each.object != number),
        colliders=tuple(each for each in stage.colliders if each.object != number),
        lights=tuple(stage.lights[row] for row in left),
        light_tracks=tuple(light_tracks),
        tracks=tuple(replace(track, instances=rows[track.instances].astype(np.int32)) for track in stage.tracks),
        color_tracks=tuple(_of_others(track, own) for track in stage.color_tracks),
    )


def _of_others(track: ColorTrack, own: NDArray[np.bool_]) -> ColorTrack:
    """Return a track without some instances, bool [n], by the rows that the others then have."""
    rows, is_left = np.cumsum(~own) - 1, ~own[track.instances]
    left = rows[track.instances[is_left]].astype(np.int32)
    return replace(track, instances=left, colors=track.colors[:, is_left])


def _painted(material: Material, override: MaterialOverride, description: SceneDescription) -> Material:
    """Return a material with its override."""
    if override.like is not None:
        row = _row(description.materials, override.like)
        if row is None:
            known = [each.prim_path for each in description.materials if each.prim_path]
            raise MaterialNotFound("material", override.like, known, f" in {description.name!r}")
        material = replace(description.materials[row], name=material.name, prim_path=material.prim_path)
    color = material.diffuse_color if override.color is None else override.color
    if isinstance(color, TextureLookup):
        factors = [each * tint for each, tint in zip(color.scale, (*override.tint, 1.0), strict=True)]
        summands = [each * tint for each, tint in zip(color.bias, (*override.tint, 1.0), strict=True)]
        scale, bias = (tuple(values) for values in (factors, summands))
        color = replace(color, scale=scale, bias=bias)  # type: ignore[arg-type]
    else:
        red, green, blue = (min(each * tint, 1.0) for each, tint in zip(color, override.tint, strict=True))
        color = (red, green, blue)
    return replace(
        material,
        diffuse_color=color,
        roughness=material.roughness if override.roughness is None else override.roughness,
        metallic=material.metallic if override.metallic is None else override.metallic,
    )
