# SPDX-License-Identifier: Apache-2.0
"""Scenarios on the stage: what an artist, or `Scenario.save`, authored by the schema of tiscene.

Scenarios pass through here as JSON values, the ones of `Scenario.to_json`: this folder knows stages, not scenarios.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd, UsdGeom

from tiscene.scene.camera import Camera
from tiscene.usd.core import schema
from tiscene.usd.core.keyframes import read_keyframes, read_lifespan
from tiscene.usd.core.limits import Limits
from tiscene.usd.core.pose import PrimPose, is_same_pose, read_pose
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.schema import authored, targets
from tiscene.usd.core.semantics import is_component, is_object_instance
from tiscene.usd.core.stage import Variants, open_stage, quiet, readable, reading_time
from tiscene.usd.core.transform import to_matrix
from tiscene.usd.core.units import Units
from tiscene.usd.lights.light import is_light
from tiscene.usd.read.stage_camera import read_camera
from tiscene.usd.read.subprocess_reader import read_in_subprocess
from tiscene.usd.scenario.light_time_samples import read_light_motion
from tiscene.usd.scenario.motion_schema import read_dynamic

_TIMINGS = {
    "allTogether": "AllTogether",
    "waitUntilComplete": "WaitUntilComplete",
    "dictTimings": "DictTimings",
}


@dataclass(frozen=True)
class AuthoredScenario:
    """content: the members of a scenario's JSON object; without `scene` if the stage itself is the scene.

    prim_paths: where its objects were authored, in their order.
    """

    content: dict[str, Any]
    prim_paths: tuple[str, ...]


def read_scenario(
    path: str | Path, *, variants: Variants | None = None, limits: Limits | None = None
) -> AuthoredScenario:
    """Read the scenario that is authored on a stage; an empty one if nothing on it moves.

    Objects are the prims with TisceneObjectAPI or TisceneMotionAPI, and those whose transform or visibility has time
    samples.

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
        report.raise_problems()
    report.warn()
    return result


def _read_as_tuple(path: str, *, variants: Variants | None) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read a scenario in a child process, which can return built-in types only."""
    result = read_scenario(path, variants=variants)
    return result.content, result.prim_paths


class _ScenarioReader:
    """Reads the scenario of one stage."""

    def __init__(self, stage: Usd.Stage, report: StageReport) -> None:
        self._stage = stage
        self._report = report
        self._units = Units.of(stage)
        self._time = reading_time(stage, None)

    def read(self) -> AuthoredScenario:
        scenarios, prims, cameras, lights = [], [], [], []
        for prim, is_object in self._walk():
            schema.report_unknown_properties(prim, self._report)
            lights += self._lights_of(prim, is_object)
            if schema.has(prim, schema.SCENARIO):
                scenarios.append(prim)
            if prim.IsA(UsdGeom.Camera):
                cameras.append(prim)
            elif is_object:
                prims.append(prim)
        root = self._strongest(scenarios)
        content: dict[str, Any] = {}
        if root:
            listed = targets(root, "tiscene:scenario:objects")
            prims = [each for path in listed if (each := self._target(root, path))] if listed else prims
            with self._report.guard(root.GetPath()):
                content = self._scenario(root)
        objects, paths = [], []
        for prim in prims:
            made = None
            with self._report.guard(prim.GetPath()):
                made = self._object(prim)
            if made is not None:
                objects.append(made)
                paths.append(str(prim.GetPath()))
        self._name(objects, paths)
        camera = None
        with self._report.guard("/"):
            camera = self._camera(root, cameras)
        content = {"lights": lights} | content if lights else content
        content |= {"objects": objects} | ({} if camera is None else {"camera": camera})
        return AuthoredScenario(content, tuple(paths))

    def _strongest(self, scenarios: list[Usd.Prim]) -> Usd.Prim | None:
        """The scenario of the strongest layer: one that was written over a scene takes the place of the scene's own."""
        layers = self._stage.GetLayerStack()
        ranks = [min((layers.index(layer) for layer in _saying_layers(prim, layers)), default=0) for prim in scenarios]
        best = [prim for prim, rank in zip(scenarios, ranks, strict=True) if rank == min(ranks)]
        for other in best[1:]:
            self._report.problem(other.GetPath(), "scenario", f"<{best[0].GetPath()}> is the scenario already")
        return best[0] if best else None

    def _lights_of(self, prim: Usd.Prim, is_object: bool) -> list[dict[str, Any]]:
        """Motions of a light, or of those inside a thing."""
        lights = []
        with self._report.guard(prim.GetPath()):
            inside = Usd.PrimRange(prim) if _is_thing(prim) and not is_object else [prim]
            for each in inside:
                motion = read_light_motion(each, self._units, self._report) if _is_lamp(each) else None
                if motion is not None:
                    lights.append(motion)
        return lights

    def _walk(self) -> Iterator[tuple[Usd.Prim, bool]]:
        """Every prim that may say something, and whether it is an object; not what is inside an object or a thing."""
        prims = iter(Usd.PrimRange(self._stage.GetPseudoRoot()))
        for prim in prims:
            is_thing = is_object = False
            with self._report.guard(prim.GetPath()):
                is_thing = _is_thing(prim)
                is_object = self._is_object(prim)
            yield prim, is_object
            if is_thing or is_object:
                prims.PruneChildren()

    def _is_object(self, prim: Usd.Prim) -> bool:
        """Whether a prim is an object of the scenario, if nobody lists them."""
        if prim.IsA(UsdGeom.Camera) or not prim.IsA(UsdGeom.Xformable) or _is_lamp(prim):
            return False
        if schema.has(prim, schema.OBJECT) or schema.has(prim, schema.MOTION):
            return True
        if not _is_thing(prim):
            return False
        return bool(read_lifespan(prim, self._report) or read_keyframes(prim, self._units, self._report))

    def _target(self, root: Usd.Prim, path: Sdf.Path) -> Usd.Prim | None:
        """A prim that the scenario lists."""
        prim = self._stage.GetPrimAtPath(path)
        if prim and prim.IsA(UsdGeom.Xformable):
            return prim
        self._report.problem(root.GetPath(), "scenario", f"its object <{path}> is no prim that can be placed")
        return None

    def _object(self, prim: Usd.Prim) -> dict[str, Any] | None:
        visibility = UsdGeom.Imageable(prim).GetVisibilityAttr()
        if not visibility.GetNumTimeSamples() and visibility.Get() == UsdGeom.Tokens.invisible:
            return None  # what is never seen is not there
        pose = read_pose(prim, self._time, self._units)
        if isinstance(pose, str):
            self._report.problem(prim.GetPath(), "transform", pose)
            return None
        exact = authored(prim, "tiscene:object:exactPose")
        position, rotation = list(pose.position), list(pose.rotation)
        if exact is not None and is_same_pose(exact, position, rotation):
            position, rotation = list(exact[:3]), list(exact[3:])
        template = authored(prim, "tiscene:object:template")
        life: dict[str, int | None] = {}
        for key, name in (("first_frame", "firstFrame"), ("last_frame", "lastFrame")):
            value = authored(prim, f"tiscene:object:{name}")
            if value is not None and value != -1:
                life[key] = int(value)
        described = schema.has(prim, schema.OBJECT)
        shown = None if described else read_lifespan(prim, self._report)
        if shown:
            life = {"first_frame": shown[0], "last_frame": shown[1]}
        content: dict[str, Any] = {
            "id": authored(prim, "tiscene:object:id") or "",
            "template": template or str(prim.GetPath()),
            "position": position,
            "rotation": rotation,
            "dynamic": self._dynamic(prim, life.get("first_frame") or 0),
        } | life
        if not described and not schema.has(prim, schema.MOTION):  # an animation is played as it is
            content |= {"frustum_limited": False, "collide": False}
        if template:  # otherwise the scale is the template's own
            content["scale"] = list(pose.scale)
        for key, name in (("frustum_limited", "frustumLimited"), ("collide", "collide")):
            value = authored(prim, f"tiscene:object:{name}")
            if value is not None:
                content[key] = bool(value)
        return content

    def _dynamic(self, prim: Usd.Prim, first_frame: int = 0) -> dict[str, Any] | None:
        dynamic = read_dynamic(prim, self._units, self._report)
        return dynamic or read_keyframes(prim, self._units, self._report, first_frame)

    @staticmethod
    def _name(objects: list[dict[str, Any]], paths: list[str]) -> None:
        """Ids for the objects without: the prim's name, or its path where that is taken."""
        taken = {each["id"] for each in objects if each["id"]}
        for content, path in zip(objects, paths, strict=True):
            if not content["id"]:
                name = Sdf.Path(path).name
                content["id"] = name if name not in taken else path
                taken.add(content["id"])

    def _scenario(self, root: Usd.Prim) -> dict[str, Any]:
        """The members of the scenario's JSON object that its own prim has."""
        content: dict[str, Any] = {}
        scene = authored(root, "tiscene:scenario:scene")
        if scene:
            content["scene"] = str(scene)
        far = authored(root, "tiscene:scenario:frustumFar")
        if far:
            content["frustum"] = {"far": -1.0 if far == -1.0 else self._units.to_json(far, True)}
        for key in ("edits", "lights"):
            text = authored(root, f"tiscene:scenario:{key}")
            if text:
                try:
                    content[key] = json.loads(text)
                except json.JSONDecodeError as error:
                    self._report.problem(root.GetPath(), "scenario", f"tiscene:scenario:{key} is not JSON: {error}")
        kind = authored(root, "tiscene:scenario:timing") or "allTogether"
        if kind not in _TIMINGS:
            text = f"tiscene:scenario:timing is {str(kind)!r}; it must be one of {', '.join(_TIMINGS)}"
            self._report.problem(root.GetPath(), "scenario", text)
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
        ids, indices, times = (
            list(authored(root, f"tiscene:scenario:{name}") or ()) for name in ("turns", "turnIndices", "turnTimes")
        )
        if len(ids) != len(times) or (indices and len(indices) != len(ids)):
            text = f"{len(ids)} turns, {len(indices)} turnIndices and {len(times)} turnTimes do not belong together"
            self._report.problem(root.GetPath(), "scenario", text)
            return []
        indices = indices or [0] * len(ids)
        return [[each or index, time] for each, index, time in zip(ids, indices, times, strict=True)]

    def _camera(self, root: Usd.Prim | None, cameras: list[Usd.Prim]) -> Any:
        """The camera as a JSON object if it moves or was written by us; its name if it was chosen; else None.

        A list of such if several were chosen.
        """
        chosen = targets(root, "tiscene:scenario:camera") if root else []
        if not chosen:
            return self._one_camera(cameras[0], False) if cameras else None
        found = []
        for path in chosen:
            prim = self._stage.GetPrimAtPath(path)
            if not prim or not prim.IsA(UsdGeom.Camera):
                assert root is not None
                self._report.problem(root.GetPath(), "scenario", f"its camera <{path}> is no Camera")
                return None
            found.append(self._one_camera(prim, True))
        return found if len(found) > 1 else found[0]

    def _one_camera(self, prim: Usd.Prim, chosen: bool) -> dict[str, Any] | str | None:
        dynamic = self._dynamic(prim)
        if dynamic is None and not schema.has(prim, schema.CAMERA):
            return str(prim.GetName()) if chosen else None
        world = UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(self._time)
        meters = self._units.meters
        camera = read_camera(prim, to_matrix(world, meters), self._time, meters, self._report)
        pose = read_pose(prim, self._time, self._units)
        if camera is None or isinstance(pose, str):
            return None
        return self._exact_camera(prim, camera, pose) | {"dynamic": dynamic}

    @staticmethod
    def _exact_camera(prim: Usd.Prim, camera: Camera, pose: PrimPose) -> dict[str, Any]:
        """A camera's JSON object, with what TisceneCameraAPI states to the last bit."""
        content = dataclasses.asdict(dataclasses.replace(camera, dynamic=None))
        content["position"] = list(pose.position)
        if len(pose.rotation) == 4:
            content["rotation"] = list(pose.rotation)
        content["name"] = authored(prim, "tiscene:camera:name") or camera.name
        for key, name in CAMERA_VALUES.items():
            value = authored(prim, f"tiscene:camera:{name}")
            if (
                value is not None
                and content[key] is not None
                and math.isclose(value, content[key], rel_tol=1e-5, abs_tol=1e-7)
            ):
                content[key] = float(value)
        return content


# Members of a camera's JSON object, and the attributes of TisceneCameraAPI that state them exactly.
CAMERA_VALUES = {
    "vertical_fov": "verticalFov",
    "lens_radius": "lensRadius",
    "focus_distance": "focusDistance",
    "near": "near",
    "far": "far",
    "exposure": "exposure",
    "orthographic_height": "viewHeight",
}


def _saying_layers(prim: Usd.Prim, layers: list[Sdf.Layer]) -> list[Sdf.Layer]:
    """Those of the stage's own layers that make a prim the scenario."""
    return [
        spec.layer
        for spec in prim.GetPrimStack()
        if spec.layer in layers
        and (spec.HasInfo("apiSchemas") or any(each.name.startswith("tiscene:scenario") for each in spec.properties))
    ]


def _is_thing(prim: Usd.Prim) -> bool:
    """Whether a prim, met from above, is a thing with an identity of its own."""
    return is_component(prim) or is_object_instance(prim) or prim.IsA(UsdGeom.Gprim)


def _is_lamp(prim: Usd.Prim) -> bool:
    """Whether a prim is a light that is nothing else; a mesh that shines is a thing."""
    return is_light(prim) and not prim.IsA(UsdGeom.Gprim)
