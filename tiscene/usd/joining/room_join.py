# SPDX-License-Identifier: Apache-2.0
"""join: write one stage out of several rooms, with openings between them."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade

from dynamics import argument_checks
from dynamics.argument_checks import brief, is_series
from tiscene import catalog
from tiscene.catalog import LAYER_SUFFIXES
from tiscene.errors import ArgumentError, ArgumentTypeError, StageError, StageWarning
from tiscene.usd.core.broken_prims import deactivate_broken
from tiscene.usd.core.layers import has_file, write_layer
from tiscene.usd.core.prims import FALLBACK_TYPES, identifier, unused_path
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import scene_name
from tiscene.usd.core.stage import open_stage, quiet, readable
from tiscene.usd.joining.floor_plan import Opening, RoomPlacement
from tiscene.usd.joining.lining import in_units, line
from tiscene.usd.joining.room_conflicts import check_conflicts
from tiscene.usd.joining.stage_cut import GprimCut, cuts, release_instances
from tiscene.usd.read.room_volumes import define_volume, has_volume, interior
from tiscene.usd.referencing.conversion import Conversion
from tiscene.usd.referencing.convert import convert
from tiscene.usd.referencing.converted_values import RESET
from tiscene.usd.referencing.forwarded_variants import forward_variants

_SKY = (UsdLux.DomeLight, UsdLux.DistantLight)


def join(
    rooms: Sequence[RoomPlacement | tuple[str | os.PathLike[str], tuple[float, float, float]]],
    path: str | os.PathLike[str],
    *,
    openings: Sequence[Opening] = (),
    name: str | None = None,
    sky: str | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Path:
    """Write a stage that references rooms, placed beside one another, with openings between them.

    - The stage has the up axis and units of the first room. Others are scaled and turned; values that this does not
      convert, such as lenses, normalized lights and densities, are written converted over the room.
    - Walls and closed doors are cut at the openings by overrides; the files of the rooms are not changed.
    - Variant sets of the rooms are variant sets of the new root, which select the same variant in all rooms.
    - Domes and distant lights light all rooms, so those of one room are kept; the dome gets the portals of all rooms.
    - Cameras are kept under the names `ROOM CAMERA`, such as "kitchen Main".
    - Each room has a volume (`frame.room`): its own, or a box over its floor up to its ceiling.

    Named in a StageWarning are openings that cut nothing, values that cannot be converted, rooms whose gravity or
    collisions change, prims outside of a room's default prim, which are left out, and prims that contradict themselves,
    such as a transform that cannot be read: they are not measured and not cut.

    Args:
        rooms: the rooms. The new stage has the up axis and units of the first; others are scaled and turned.
        path: the file to write, .usda, .usdc or .usd. References are relative to it.
        openings: passages between the rooms.
        name: name of the root prim; None: from the file's name.
        sky: name of the room whose domes and distant lights are kept; None: the first room that has any.
        progress: called with what is being done, and the fraction of it that is; large rooms take half a minute.

    Returns:
        The path of the file.

    Raises:
        ArgumentError: an argument is invalid, such as no rooms, one that is no placement, two rooms of one name, an
            unknown `sky`, or a `path` with another suffix or that is a file of a room.
        SceneNotFound, MissingFile: there is no file of a room.
        StageError: a room cannot be read, two rooms have a scenario, or an opening meets a shape that cannot be cut.
        ExportError: the file cannot be written.
    """
    target = Path(_file(path, "path"))
    if not is_series(rooms):
        raise ArgumentTypeError(f"rooms={brief(rooms)}: must be a sequence of rooms, each (file, position)")
    openings = tuple(openings) if is_series(openings) else openings
    if not isinstance(openings, tuple) or not all(isinstance(each, Opening) for each in openings):
        raise ArgumentTypeError(f"openings={brief(openings)}: must be a sequence of Opening(position, ...)")
    if name is not None and not Sdf.Path.IsValidIdentifier(argument_checks.text(name, "name")):
        raise ArgumentError(f"name={name!r}: must be the name of a prim, such as {identifier(name)!r}")
    if target.suffix.lower() not in LAYER_SUFFIXES:
        raise ArgumentError(f"join(path={str(path)!r}): must end in {', '.join(LAYER_SUFFIXES)}")
    placements = [_placement(number, each) for number, each in enumerate(rooms)]
    names = _identifiers(placements)
    if sky is not None and sky not in [each.label for each in placements]:
        raise ArgumentError(f"join(sky={sky!r}): the rooms are {', '.join(each.label for each in placements)}")
    with quiet(), readable(target):
        stages = _open(placements, target)
        up_axis, meters = str(UsdGeom.GetStageUpAxis(stages[0])), float(UsdGeom.GetStageMetersPerUnit(stages[0]))
        name = name or identifier(scene_name(target).title().replace("_", ""))
        stage = _empty_stage(target, name, stages)
        root = stage.GetDefaultPrim()
        placed = [
            _place(stage, f"{root.GetPath()}/{each}", room, placement)
            for each, room, placement in zip(names, stages, placements, strict=True)
        ]
        if errors := [str(each) for each in stage.GetCompositionErrors()]:
            raise StageError(str(target), errors)
        prims = [prim for prim, _ in placed]
        progress = progress or (lambda task, done: None)
        for number, ((prim, conversion), placement) in enumerate(zip(placed, placements, strict=True)):
            progress(f"converting {placement.label}", number / len(placed))
            report = StageReport(str(placement.file))
            convert(prim, conversion, report)
            report.warn()
        check_conflicts(dict(zip([each.label for each in placements], prims, strict=True)), str(target))
        choices = forward_variants(root, {prim.GetPath(): prim for prim in prims})
        for prim, placement in zip(prims, placements, strict=True):
            _prepare(prim, placement)
        _keep_one_sky(prims, [each.label for each in placements], sky)
        boxes = [np.asarray(np.linalg.inv(in_units(each.box(up_axis), meters)), np.float64) for each in openings]
        cut = _cut(stage, root, boxes, choices, progress)
        line(stage, root, openings, up_axis, meters)
        _export(stage, target, dict(zip([prim.GetPath() for prim in prims], placements, strict=True)))
        progress("joining", 1.0)
    idle = [openings[row] for row in range(len(boxes)) if row not in cut]
    if idle:
        places = "; ".join(f"at {each.position}, yaw {each.yaw:g}" for each in idle)
        text = f"{target}: openings that cut nothing, since no wall is there: {places}"
        warnings.warn(StageWarning(text), stacklevel=2)
    return target


def _placement(number: int, room: object) -> RoomPlacement:
    """Return a room as a placement."""
    if not isinstance(room, tuple | list) or not 1 <= len(room) <= len(RoomPlacement._fields):
        raise ArgumentError(f"join(rooms=): room {number} is {room!r}; expected (file, position) or a RoomPlacement")
    file, place, yaw, name = RoomPlacement(*room)
    at = f"rooms[{number}]"
    return RoomPlacement(
        catalog.find_scene(_file(file, f"{at}: file")),
        argument_checks.position(place, f"{at}: position"),
        argument_checks.number(yaw, f"{at}: yaw"),
        argument_checks.text(name, f"{at}: name") if name != "" else "",
    )


def _file(value: object, name: str) -> str:
    """Return the name of a file, which USD requires to be UTF-8."""
    return argument_checks.text(os.fspath(value) if isinstance(value, os.PathLike) else value, name)


def _identifiers(placements: Sequence[RoomPlacement]) -> list[str]:
    """Return the prim names of the rooms."""
    names = [identifier(each.label) for each in placements]
    if not names:
        raise ArgumentError("join(rooms=[]): expected at least one room, such as ('kitchen.usda', (0, 0, 0))")
    twice = sorted({each for each in names if names.count(each) > 1})
    if twice:
        raise ArgumentError(f"join: several rooms are called {', '.join(twice)}; give each a name, name=...")
    return names


def _open(placements: Sequence[RoomPlacement], target: Path) -> list[Usd.Stage]:
    """Return the stages of the rooms; the file to write must not be one of theirs."""
    stages = [open_stage(Path(each.file)) for each in placements]
    for stage, placement in zip(stages, placements, strict=True):
        if not stage.GetDefaultPrim():
            raise StageError(str(placement.file), ["has no default prim, which a reference needs"])
        _name_outside(stage, placement, target)
        if has_file(stage, target):
            raise ArgumentError(
                f"join(path={str(target)!r}): is a file of the room {placement.file}; write another file"
            )
    return stages


def _name_outside(stage: Usd.Stage, placement: RoomPlacement, target: Path) -> None:
    """Warn of what a room has outside of its default prim, which a reference does not bring along."""
    kinds = (UsdGeom.Xformable, UsdShade.Material, UsdPhysics.Scene, UsdPhysics.Joint, UsdPhysics.CollisionGroup)
    lost = [
        f"<{prim.GetPath()}>"
        for prim in stage.GetPseudoRoot().GetChildren()
        if prim != stage.GetDefaultPrim() and any(each.IsA(kind) for each in Usd.PrimRange(prim) for kind in kinds)
    ]
    if lost:
        text = f"{', '.join(lost)} outside of the default prim <{stage.GetDefaultPrim().GetPath()}>: not in {target}"
        warnings.warn(StageWarning(f"{placement.file}: {text}; move it below the default prim"), stacklevel=4)


def _empty_stage(target: Path, name: str, rooms: Sequence[Usd.Stage]) -> Usd.Stage:
    """Return a stage with an assembly as its default prim.

    It has the axes, units and render settings of the first room, the range of time codes over all rooms, and the types
    by which they replace unknown ones.
    """
    layer = Sdf.Layer.CreateAnonymous(f"{target.stem}.usda")
    if fallbacks := _fallback_types(rooms):
        layer.pseudoRoot.SetInfo(FALLBACK_TYPES, fallbacks)
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(rooms[0]))
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(rooms[0]))
    if UsdPhysics.StageHasAuthoredKilogramsPerUnit(rooms[0]):
        UsdPhysics.SetStageKilogramsPerUnit(stage, UsdPhysics.GetStageKilogramsPerUnit(rooms[0]))
    timed = [each for each in rooms if each.HasAuthoredTimeCodeRange()]
    if timed:
        rate = timed[0].GetTimeCodesPerSecond()
        stage.SetTimeCodesPerSecond(rate)  # USD scales the time codes of rooms with another rate
        stage.SetStartTimeCode(min(each.GetStartTimeCode() * rate / each.GetTimeCodesPerSecond() for each in timed))
        stage.SetEndTimeCode(max(each.GetEndTimeCode() * rate / each.GetTimeCodesPerSecond() for each in timed))
    root = UsdGeom.Xform.Define(stage, f"/{name}").GetPrim()
    Usd.ModelAPI(root).SetKind(Kind.Tokens.assembly)
    stage.SetDefaultPrim(root)
    _copy_render_settings(rooms[0], stage)
    return stage


def _fallback_types(rooms: Sequence[Usd.Stage]) -> dict[str, Any]:
    """Return the types that replace those unknown to USD, of all rooms; warn of those that rooms replace otherwise."""
    merged: dict[str, Any] = {}
    for room in rooms:
        for name, types in (room.GetMetadata(FALLBACK_TYPES) or {}).items():
            if list(merged.setdefault(name, types)) != list(types):
                text = f"{FALLBACK_TYPES} of {name} are {', '.join(types)}; those of a room before count: "
                text += ", ".join(merged[name])
                warnings.warn(StageWarning(f"{room.GetRootLayer().realPath}: {text}"), stacklevel=4)
    return merged


def _copy_render_settings(source: Usd.Stage, stage: Usd.Stage) -> None:
    """Copy the render settings of a stage, which references do not bring along."""
    path = source.GetMetadata("renderSettingsPrimPath")
    top = Sdf.Path(str(path)).GetPrefixes()[0] if path else None
    if top is not None and source.GetRootLayer().GetPrimAtPath(top):
        Sdf.CopySpec(source.GetRootLayer(), top, stage.GetRootLayer(), top)
        stage.SetMetadata("renderSettingsPrimPath", str(path))


def _place(stage: Usd.Stage, path: str, source: Usd.Stage, placement: RoomPlacement) -> tuple[Usd.Prim, Conversion]:
    """Reference a room by a new prim that places, turns and scales it; return also what its transform converts."""
    room, conversion = source.GetDefaultPrim(), Conversion.between(source, stage)
    prim = stage.DefinePrim(path, "" if room.IsA(UsdGeom.Gprim) else "Xform")  # a room may be one mesh
    xform = UsdGeom.Xformable(prim)
    prim.GetReferences().AddReference(str(Path(placement.file).resolve()))
    if prim.IsInstanceable():
        prim.SetInstanceable(False)
    Usd.ModelAPI(prim).SetKind(Kind.Tokens.assembly)
    own = list(xform.GetXformOpOrderAttr().Get() or [])
    while RESET in own:  # it would leave the room where it is
        own = own[own.index(RESET) + 1 :]
    meters = UsdGeom.GetStageMetersPerUnit(stage)
    ops = [xform.AddTranslateOp(opSuffix="room")]
    ops[0].Set(Gf.Vec3d(*(round(value / meters, 9) for value in placement.position)))
    if placement.yaw:
        turn = xform.AddRotateYOp if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else xform.AddRotateZOp
        ops.append(turn(opSuffix="room"))
        ops[-1].Set(float(placement.yaw))
    if conversion.degrees_about_x:
        ops.append(xform.AddRotateXOp(opSuffix="room"))
        ops[-1].Set(conversion.degrees_about_x)
    if conversion.length != 1.0:
        ops.append(xform.AddScaleOp(UsdGeom.XformOp.PrecisionDouble, "room"))
        ops[-1].Set(Gf.Vec3d(conversion.length))
    xform.GetXformOpOrderAttr().Set([*(op.GetOpName() for op in ops), *own])
    world = Gf.Matrix4d(1.0)
    for op in ops:
        world = op.GetOpTransform(Usd.TimeCode.Default()) * world
    return prim, replace(conversion, world=world)


def _prepare(room: Usd.Prim, placement: RoomPlacement) -> None:
    """Leave out what is broken in a room, on this stage only, and give it a volume if it has none."""
    report = StageReport(str(placement.file))
    deactivate_broken(room, report)  # what is written still has them
    report.raise_problems(anything_left=room.IsActive())
    report.warn()
    if not has_volume(room):
        path = unused_path(room.GetStage(), room.GetPath(), "RoomVolume")
        define_volume(room.GetStage(), path, *interior(room), placement.label)


def _keep_one_sky(rooms: Sequence[Usd.Prim], labels: Sequence[str], chosen: str | None) -> None:
    """Deactivate the domes and distant lights of all rooms but one, and give its domes the portals of all."""
    found = {
        label: [prim for prim in Usd.PrimRange(room) if any(prim.IsA(kind) for kind in _SKY)]
        for label, room in zip(labels, rooms, strict=True)
    }
    keeper = chosen if chosen is not None else next((label for label, prims in found.items() if prims), None)
    domes = [UsdLux.DomeLight(prim) for prims in found.values() for prim in prims if prim.IsA(UsdLux.DomeLight)]
    portals = [path for dome in domes for path in dome.GetPortalsRel().GetForwardedTargets()]
    for label, prims in found.items():
        for prim in prims:
            if label != keeper:
                prim.SetActive(False)
            elif prim.IsA(UsdLux.DomeLight) and portals:
                UsdLux.DomeLight(prim).CreatePortalsRel().SetTargets(portals)


def _cut(
    stage: Usd.Stage,
    root: Usd.Prim,
    boxes: Sequence[NDArray[np.float64]],
    choices: Mapping[str, Sequence[str]],
    progress: Callable[[str, float], None],
) -> set[int]:
    """Author the cuts; where a variant set changes what is cut, in its variants. Return the rows of boxes that cut."""
    if not boxes:
        return set()
    task, steps, done = "cutting openings", 1 + sum(map(len, choices.values())), 0
    progress(task, 0.0)
    release_instances(stage, boxes)
    plain = cuts(stage, boxes)
    shaping: dict[str, dict[str, dict[Sdf.Path, GprimCut]]] = {}
    for name, variants in choices.items():
        found = {}
        for variant in _each_selected(root.GetVariantSet(name), variants):
            done += 1
            progress(task, done / steps)
            deactivate_broken(root, StageReport(""))  # those of the variants that are not shown are named by streams
            found[variant] = cuts(stage, boxes)
        if any(not _same(each, plain) for each in found.values()):
            shaping[name] = found
    if len(shaping) > 1:
        raise StageError(
            stage.GetRootLayer().GetDisplayName(),
            [f"the variant sets {', '.join(sorted(shaping))} all change the walls at the openings; at most one may"],
        )
    if not shaping:
        for each in plain.values():
            each.author(stage)
    for name, found in shaping.items():
        variant_set = root.GetVariantSet(name)
        for variant in _each_selected(variant_set, found):
            with variant_set.GetVariantEditContext():
                for each in found[variant].values():
                    each.author(stage)
    made = [plain, *(changed for found in shaping.values() for changed in found.values())]
    return {row for changed in made for each in changed.values() for row in each.boxes}


def _each_selected(variant_set: Usd.VariantSet, variants: Iterable[str]) -> Iterator[str]:
    """Yield variants, each while it is selected; then the selection is as before."""
    selected = variant_set.GetVariantSelection()
    for variant in variants:
        variant_set.SetVariantSelection(variant)
        yield variant
    variant_set.SetVariantSelection(selected)


def _same(first: Mapping[Sdf.Path, GprimCut], second: Mapping[Sdf.Path, GprimCut]) -> bool:
    return first.keys() == second.keys() and all(each.same_as(second[path]) for path, each in first.items())


def _export(stage: Usd.Stage, target: Path, rooms: Mapping[Sdf.Path, RoomPlacement]) -> None:
    """Write the root layer with references relative to it."""
    layer = Sdf.Layer.CreateAnonymous(target.suffix or ".usda")
    layer.TransferContent(stage.GetRootLayer())
    for path, placement in rooms.items():
        relative = Path(os.path.relpath(Path(placement.file).resolve(), target.resolve().parent)).as_posix()
        asset = relative if relative.startswith(".") else f"./{relative}"
        layer.GetPrimAtPath(path).referenceList.prependedItems = [Sdf.Reference(asset)]
    write_layer(layer, target)
