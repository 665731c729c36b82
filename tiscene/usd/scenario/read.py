# SPDX-License-Identifier: Apache-2.0
"""read_scenario: the scenario that an artist, or `Scenario.save`, has authored on a stage by tiscene's schema.

The result is the JSON object of a scenario (`Scenario.to_json`), since `tiscene.usd` does not import
`tiscene.scenario`. Objects and cameras animated by time samples get `Keyframes`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdGeom

from tiscene.usd.core import schema
from tiscene.usd.core.keyframes import plays_in_parts, read_keyframes, read_lifespan
from tiscene.usd.core.limits import Limits
from tiscene.usd.core.pose import is_same_pose, read_pose
from tiscene.usd.core.prims import ancestors, is_light_only
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.schema import authored, targets
from tiscene.usd.core.semantics import is_outermost_object, object_name
from tiscene.usd.core.shown_prims import is_shown, shows_geometry
from tiscene.usd.core.stage import Variants, open_stage, quiet, readable, reading_time
from tiscene.usd.core.transform import to_matrix
from tiscene.usd.core.units import Units
from tiscene.usd.geometry.skinning import baked_paths
from tiscene.usd.read.object_builder import may_collide
from tiscene.usd.read.stage_camera import read_camera, unique_names
from tiscene.usd.read.stage_render_settings import read_render_settings
from tiscene.usd.read.subprocess_reader import read_in_subprocess
from tiscene.usd.scenario.filtered_pairs_schema import read_filtered_pairs
from tiscene.usd.scenario.joint_schema import read_joints
from tiscene.usd.scenario.layer_files import layer_file
from tiscene.usd.scenario.light_time_samples import read_light_motion
from tiscene.usd.scenario.motion_schema import read_dynamic
from tiscene.usd.scenario.rigid_body_schema import read_rigid_body
from tiscene.usd.scenario.stage_cameras import exact_camera, listed_name, stage_cameras

_TIMINGS = {schema.token(name): name for name in ("AllTogether", "WaitUntilComplete", "DictTimings")}


@dataclass(frozen=True)
class AuthoredScenario:
    """A scenario as read from a stage.

    Attributes:
        content: members of the scenario's JSON object; without `scene` if the stage itself is the scene.
        prim_paths: prims of its objects, in their order.
        cameras: the stage's cameras that move, JSON objects by name and by path, for a choice of other cameras than the
            scenario's.
    """

    content: dict[str, Any]
    prim_paths: tuple[str, ...]
    cameras: dict[str, dict[str, Any]]


def read_scenario(
    path: str | Path, *, variants: Variants | None = None, limits: Limits | None = None
) -> AuthoredScenario:
    """Read the scenario that is authored on a stage; an empty one if nothing on it moves.

    Objects are the prims with TisceneObjectAPI or TisceneMotionAPI, and those whose transform has time samples.

    Args:
        path: the file.
        variants: variant selections, `{"/Room{lighting}": "night"}`.
        limits: upper bounds of time and memory. With them the file is read in a child process; None: in this process,
            without bounds.

    Raises:
        MissingFile: there is no such file.
        StageError: the scenario cannot be read (lists every problem found), or a limit is exceeded.

    Content that is left out is listed in one StageWarning.
    """
    if limits is not None:
        return AuthoredScenario(*read_in_subprocess(_read_as_tuple, path, {"variants": variants}, limits))
    with quiet(), readable(path):
        stage = open_stage(path, variants)
        report = StageReport(str(path))
        reader = _ScenarioReader(stage, report)
        result = reader.read()
        report.raise_refused()  # `read_stage` names broken prims; here they do not move
    report.warn(problems=False)
    return result


def _read_as_tuple(path: str, *, variants: Variants | None) -> tuple[Any, ...]:
    """Read a scenario in a child process, which can return built-in types only."""
    result = read_scenario(path, variants=variants)
    return result.content, result.prim_paths, result.cameras


class _ScenarioReader:
    """Reads the scenario of one stage."""

    def __init__(self, stage: Usd.Stage, report: StageReport) -> None:
        self._stage = stage
        self._report = report
        self._units = Units.of(stage)
        self._time = reading_time(stage, None)
        self._settings = read_render_settings(stage)
        self._baked = baked_paths(stage)
        self._physics = False  # whether objects without a dynamic are rigid bodies
        self._is_whole = False  # whether the scenario names its scene: nothing else moves, as where it was saved

    def read(self) -> AuthoredScenario:
        scenarios, prims, lights = [], [], []
        for prim, is_object in self._walk():
            schema.report_invalid_properties(prim, self._report)
            lights += self._lights_of(prim, is_object)
            if schema.has(prim, schema.SCENARIO):
                scenarios.append(prim)
            if is_object:
                prims.append(prim)
        root = self._strongest(scenarios)
        content: dict[str, Any] = {}
        if root:
            self._is_whole = bool(authored(root, "tiscene:scenario:scene"))
            listed = targets(root, "tiscene:scenario:objects")
            if listed or (self._is_whole and root.GetRelationship("tiscene:scenario:objects").HasAuthoredTargets()):
                prims = [each for path in listed if (each := self._target(root, path))]
            elif self._is_whole:
                prims = [each for each in prims if schema.has(each, schema.OBJECT, schema.MOTION)]
            lights = [] if self._is_whole else lights
            with self._report.guard(root.GetPath()):
                content = self._scenario(root)
        self._physics = content.get("physics", False)
        objects, paths = [], []
        for prim in prims:
            made = None
            with self._report.guard(prim.GetPath()):
                made = self._object(prim)
            if made is not None:
                objects.append(made)
                paths.append(str(prim.GetPath()))
        self._name(objects, paths)
        other = {"type": "RigidBody" if self._physics else None}
        rigid = {each["id"] for each in objects if (each["dynamic"] or other)["type"] == "RigidBody"}
        content |= read_filtered_pairs(self._stage, root, objects, paths, rigid, self._report)
        content |= read_joints(self._stage, objects, paths, rigid, self._time, self._report)
        cameras = self._settings.main_first(stage_cameras(self._stage), Usd.Prim.GetPath)
        camera, moving = None, {}
        with self._report.guard("/"):
            camera = self._camera(root, cameras)
            moving = self._moving_cameras(cameras)
        content = {"lights": lights} | content if lights else content
        content |= {"objects": objects} | ({} if camera is None else {"camera": camera})
        return AuthoredScenario(content, tuple(paths), moving)

    def _strongest(self, scenarios: list[Usd.Prim]) -> Usd.Prim | None:
        """Return the scenario prim of the strongest layer: a scenario written over a scene replaces the scene's own."""
        layers = self._stage.GetLayerStack()
        ranks = [
            min((layers.index(layer) for layer in _authoring_layers(prim, layers)), default=0) for prim in scenarios
        ]
        best = [prim for prim, rank in zip(scenarios, ranks, strict=True) if rank == min(ranks)]
        for other in best[1:]:
            self._report.refuse(other.GetPath(), "scenario", f"<{best[0].GetPath()}> is the scenario already")
        return best[0] if best else None

    def _lights_of(self, prim: Usd.Prim, is_object: bool) -> list[dict[str, Any]]:
        """Return the motions of a light, or of the lights within an object or an instance of the stage."""
        lights = []
        with self._report.guard(prim.GetPath()):
            closed = prim.IsInstance() or is_outermost_object(prim)  # `_walk` does not enter it
            inside = Usd.PrimRange(prim, Usd.TraverseInstanceProxies()) if closed and not is_object else [prim]
            for each in inside:
                shown = is_light_only(each) and is_shown(each, self._time)
                motion = read_light_motion(each, self._units, self._report) if shown else None
                if motion is not None:
                    lights.append(motion)
        return lights

    def _walk(self) -> Iterator[tuple[Usd.Prim, bool]]:
        """Yield each prim and whether it is an object of the scenario.

        Prims within an object are left out, but for those within an object of the stage that a schema makes objects.
        """
        prims = iter(Usd.PrimRange(self._stage.GetPseudoRoot()))
        for prim in prims:
            is_stage_object = is_object = False
            with self._report.guard(prim.GetPath()):
                is_stage_object = is_outermost_object(prim)
                is_object = self._is_object(prim)
            yield prim, is_object
            if is_stage_object or is_object:
                prims.PruneChildren()
            if is_stage_object and not is_object and not prim.IsInstance():
                yield from ((each, True) for each in self._made_objects(prim))

    def _made_objects(self, root: Usd.Prim) -> Iterator[Usd.Prim]:
        """Yield the prims within an object of the stage that a schema makes objects of the scenario."""
        prims = iter(Usd.PrimRange(root))
        for prim in prims:
            if prim.IsA(UsdGeom.Xformable) and schema.has(prim, schema.OBJECT, schema.MOTION):
                if self._is_object(prim):
                    yield prim
                prims.PruneChildren()

    def _is_object(self, prim: Usd.Prim) -> bool:
        """Return whether a prim is an object of a scenario that does not list its objects."""
        if prim.IsA(UsdGeom.Camera) or not prim.IsA(UsdGeom.Xformable) or is_light_only(prim):
            return False
        if schema.has(prim, schema.OBJECT, schema.MOTION):
            return True
        if not is_outermost_object(prim) or plays_in_parts(prim) or prim.GetPath() in self._baked:
            return False
        return shows_geometry(prim, self._time) and read_keyframes(prim, self._units, self._report) is not None

    def _target(self, root: Usd.Prim, path: Sdf.Path) -> Usd.Prim | None:
        """Return a prim that the scenario lists; None, with a problem, if it cannot be an object."""
        prim = self._stage.GetPrimAtPath(path)
        if prim and prim.IsA(UsdGeom.Xformable):
            return prim
        self._report.refuse(root.GetPath(), "scenario", f"its object <{path}> is not a transformable prim")
        return None

    def _object(self, prim: Usd.Prim) -> dict[str, Any] | None:
        """Return an object's JSON object; None if it is not shown or, with a problem, for an invalid transform."""
        if not is_shown(prim, self._time):
            return None
        pose = read_pose(prim, self._time, self._units)
        if isinstance(pose, str):
            self._report.problem(prim.GetPath(), "transform", pose)
            return None
        exact = authored(prim, "tiscene:object:exactPose")
        position, rotation = list(pose.position), list(pose.rotation)
        if exact is not None and is_same_pose(exact, position, rotation):
            position, rotation = list(exact[:3]), list(exact[3:])
        template = layer_file(prim, "tiscene:object:template")
        lifespan: dict[str, int | None] = {}
        for key, name in (("first_frame", "firstFrame"), ("last_frame", "lastFrame")):
            value = authored(prim, f"tiscene:object:{name}")
            if value is not None and value != -1:
                lifespan[key] = int(value)
        has_schema = schema.has(prim, schema.OBJECT)
        visible = None if has_schema else read_lifespan(prim, self._report)
        if visible:
            lifespan = {"first_frame": visible[0], "last_frame": visible[1]}
        content: dict[str, Any] = {
            "id": authored(prim, "tiscene:object:id") or "",
            "template": template or str(prim.GetPath()),
            "position": position,
            "rotation": rotation,
            "dynamic": self._dynamic(prim, lifespan.get("first_frame") or 0),
        } | lifespan
        if not has_schema and not schema.has(prim, schema.MOTION):  # animation by time samples is played exactly
            content |= {"frustum_limited": False, "collide": False}
        if template:  # else the scale is part of the template
            content["scale"] = list(pose.scale)
        elif not may_collide(prim):
            content["collide"] = False
        for key, name in (("frustum_limited", "frustumLimited"), ("collide", "collide")):
            value = authored(prim, f"tiscene:object:{name}")
            if value is not None:
                content[key] = bool(value)
        return content

    def _dynamic(self, prim: Usd.Prim, first_frame: int = 0) -> dict[str, Any] | None:
        dynamic = read_dynamic(prim, self._units, self._report)
        dynamic = dynamic or read_keyframes(prim, self._units, self._report, first_frame)
        if dynamic or schema.has(prim, schema.MOTION):
            return dynamic
        return read_rigid_body(prim, self._units, self._physics, self._time, self._report)

    def _name(self, objects: list[dict[str, Any]], paths: list[str]) -> None:
        """Give objects without an id their name on the stage, or the path of their prim if that name is taken."""
        taken = {each["id"] for each in objects if each["id"]}
        for content, path in zip(objects, paths, strict=True):
            if not content["id"]:
                name = object_name(self._stage.GetPrimAtPath(path))
                content["id"] = name if name not in taken else path
                taken.add(content["id"])

    def _scenario(self, root: Usd.Prim) -> dict[str, Any]:
        """Return the members of the scenario's JSON object that are authored on its own prim."""
        content: dict[str, Any] = {}
        if scene := layer_file(root, "tiscene:scenario:scene"):
            content["scene"] = scene
        if far := authored(root, "tiscene:scenario:frustumFar"):
            content["frustum"] = {"far": -1.0 if far == -1.0 else self._units.to_json(far)}
        if stops := authored(root, "tiscene:scenario:exposureCompensation"):
            content["exposure_compensation"] = float(stops)
        if authored(root, "tiscene:scenario:physics"):
            content["physics"] = True
        for key in ("edits", "lights", "variants", "overrides"):
            if text := authored(root, f"tiscene:scenario:{key}"):
                try:
                    content[key] = json.loads(text)
                except json.JSONDecodeError as error:
                    self._report.refuse(root.GetPath(), "scenario", f"tiscene:scenario:{key} is not JSON: {error}")
        kind = authored(root, "tiscene:scenario:timing") or "allTogether"
        if kind not in _TIMINGS:
            text = f"tiscene:scenario:timing is {str(kind)!r}; it must be one of {', '.join(_TIMINGS)}"
            self._report.refuse(root.GetPath(), "scenario", text)
            return content
        timings: dict[str, Any] = {"type": _TIMINGS[kind]}
        if kind == "dictTimings":
            timings["times"] = self._turns(root)
        else:
            timings["wait_time"] = float(authored(root, "tiscene:scenario:waitTime") or 0.0)
        if kind != "allTogether":
            repeat = authored(root, "tiscene:scenario:repeat")
            timings["repeat"] = True if repeat is None else bool(repeat)
        return content | {"timings": timings}

    def _turns(self, root: Usd.Prim) -> list[list[Any]]:
        """Return the turns of DictTimings: id or index of the object, seconds."""
        ids, indices, times = (
            list(authored(root, f"tiscene:scenario:{name}") or ()) for name in ("turns", "turnIndices", "turnTimes")
        )
        if len(ids) != len(times) or (indices and len(indices) != len(ids)):
            text = f"turns ({len(ids)}), turnIndices ({len(indices)}) and turnTimes ({len(times)}) must be equally many"
            self._report.refuse(root.GetPath(), "scenario", text)
            return []
        indices = indices or [0] * len(ids)
        return [[each or index, time] for each, index, time in zip(ids, indices, times, strict=True)]

    def _moving_cameras(self, cameras: list[Usd.Prim]) -> dict[str, dict[str, Any]]:
        """Return the JSON objects of the cameras that move, by the names that `read_stage` gives them, and by path."""
        names = unique_names([prim.GetPath() for prim in cameras])
        moving = {}
        for prim in cameras:
            content = self._one_camera(prim, False)
            if isinstance(content, dict):
                path = prim.GetPath()
                moving[names[path]] = moving[str(path)] = content | {"name": names[path]}
        for prim in cameras:
            if any(schema.has(parent, schema.MOTION) for parent in ancestors(prim)):
                text = "a camera below a prim of TisceneMotionAPI does not follow it"
                self._report.omission(prim.GetPath(), text)
        return moving

    def _camera(self, root: Usd.Prim | None, cameras: list[Usd.Prim]) -> Any:
        """Return the camera, or a list of them if the scenario lists several.

        A camera that is animated or of TisceneCameraAPI is a JSON object; another one that is listed is a name, else
        None.
        """
        listed = targets(root, "tiscene:scenario:camera") if root else []
        if not listed and self._is_whole:
            return None
        if not listed:
            return self._one_camera(cameras[0], False) if cameras else None
        found = []
        for path in listed:
            prim = self._stage.GetPrimAtPath(path)
            if not prim or not prim.IsA(UsdGeom.Camera):
                assert root is not None
                self._report.refuse(root.GetPath(), "scenario", f"its camera <{path}> is not a Camera")
                return None
            found.append(self._one_camera(prim, True))
        return found if len(found) > 1 else found[0]

    def _one_camera(self, prim: Usd.Prim, is_listed: bool) -> dict[str, Any] | str | None:
        is_exact = schema.has(prim, schema.CAMERA)
        dynamic = self._dynamic(prim) if is_exact or not (is_listed and self._is_whole) else None
        if dynamic is None and not is_exact:
            return listed_name(prim) if is_listed else None
        world = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(self._time)
        meters = self._units.meters
        camera = read_camera(prim, to_matrix(world, meters), self._time, meters, self._report, self._settings)
        pose = read_pose(prim, self._time, self._units)
        if camera is None or isinstance(pose, str):
            return None
        return exact_camera(prim, camera, pose, self._report) | {"dynamic": dynamic}


def _authoring_layers(prim: Usd.Prim, layers: list[Sdf.Layer]) -> list[Sdf.Layer]:
    """Return the layers of the stage's layer stack that make a prim the scenario."""
    return [
        spec.layer
        for spec in prim.GetPrimStack()
        if spec.layer in layers
        and (spec.HasInfo("apiSchemas") or any(each.name.startswith("tiscene:scenario") for each in spec.properties))
    ]
