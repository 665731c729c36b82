# SPDX-License-Identifier: Apache-2.0
"""Scenario: what happens in a scene, as plain frozen values that can be compared, copied and written to a file.

It is the paper's Θ: a scene, objects with their trajectories and lifespans, the timings that tie them together, the
frustum that bounds them, cameras and lights. It holds names, not meshes; `tiscene.world` evaluates it.

Rotations are Euler angles (x, y, z) in degrees, or quaternions (w, x, y, z). Euler angles turn about the fixed z axis,
then x, then y, each right-handed: x is pitch (positive looks up), y is yaw (positive turns left), z is roll.

Frame k shows the time k / fps. Lifespans count frames, both ends included. The clock of an object's trajectory counts
the time during which the object was alive and active by the timings: an object that appears later starts its path when
it appears. Before its start an object on a path stands at waypoint 0. `position` and `rotation` place trajectories that
do not name poses of their own. A camera's clock is the stream's time: timings order objects only.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dynamics import AllTogether, RigidBody, Timing
from dynamics.argument_checks import brief, flag, number, set_checked, text
from tiscene import catalog
from tiscene.errors import ArgumentError, ScenarioError, scenario_errors
from tiscene.scenario import serialization
from tiscene.scenario.edits import Edit, EditLog, Spawn
from tiscene.scenario.filtered_pairs import check_filtered_pairs
from tiscene.scenario.joints import Joint, check_joints
from tiscene.scenario.light_motion import LightMotion
from tiscene.scenario.objects import Frustum, Object, path_of
from tiscene.scenario.overrides import Override
from tiscene.scenario.providers import provider
from tiscene.scenario.relative_files import from_folder
from tiscene.scenario.scenario_fields import (
    FIELDS,
    check_cameras,
    check_edits,
    check_lights,
    check_objects,
    check_overrides,
    check_variants,
    classes,
)
from tiscene.scene.camera import Camera

MAX_STOPS = 100.0  # of exposure compensation
FORMAT, VERSION = "tiscene.scenario", 1
# Factors that `Scenario.sample` draws after the objects, in this order: each keeps clear of what was drawn before.
DRAWN_FACTORS = ("clutter", "furniture", "views", "illumination", "materials")
Range = float | tuple[float, float]
WholeRange = int | tuple[int, int]


@dataclass(frozen=True)
class Scenario:
    """What happens in a scene.

    Attributes:
        scene: name or file of the scene.
        objects: objects in addition to those of the scene.
        timings: when the objects move.
        frustum: walls at the edges of the main camera's view; None: no walls.
        camera: a Camera (which may have a trajectory), the name or prim path of one on the stage, or None for the
            stage's own. Several watch the same world; the first is the main camera.
        edits: edits made while a stream ran, in the order in which they were made; see `tiscene.scenario.edits`.
        lights: motion and intensity of lights of the stage.
        variants: variant selections on the stage by prim and set, {"/Room02{lighting}": "night"}.
        overrides: changes of lights, materials, objects and cameras of the stage, for all frames; see
            `tiscene.scenario.overrides`.
        exposure_compensation: stops by which `rgb` is brighter than the cameras' exposure makes it.
        physics: objects without a trajectory get a RigidBody(): they fall and are pushed. Objects with `Still()` stay.
            Needs the extra `physics`.
        joints: joints between rigid bodies, and between them and the world or objects on paths; see
            `tiscene.scenario.joints`.
        filtered_pairs: pairs that do not collide, of which one is a rigid body: ids of two objects, or an id and the
            path of a prim of the stage, which stands for all below it.

    Raises:
        ScenarioError: the parts contradict each other, such as timings that cannot work for a trajectory.
    """

    scene: str
    objects: Sequence[Object] = ()
    timings: Timing = field(default_factory=lambda: AllTogether(0.0))
    frustum: Frustum | None = None
    camera: Camera | str | Sequence[Camera | str] | None = None
    edits: Sequence[Edit] = ()
    lights: Sequence[LightMotion] = ()
    variants: Mapping[str, str] = field(default_factory=dict, hash=False)
    overrides: Sequence[Override] = ()
    exposure_compensation: float = 0.0
    physics: bool = False
    joints: Sequence[Joint] = ()
    filtered_pairs: Sequence[tuple[str, str]] = ()

    def __post_init__(self) -> None:
        scene = os.fspath(self.scene) if isinstance(self.scene, os.PathLike) else self.scene
        with scenario_errors():
            object.__setattr__(self, "scene", text(scene, "scene"))
            set_checked(self, objects=check_objects, physics=flag)
            if self.physics:
                rigid = tuple(replace(each, dynamic=each.dynamic or RigidBody()) for each in self.objects)
                object.__setattr__(self, "objects", rigid)
            if not isinstance(self.timings, Timing):
                raise ScenarioError(f"timings={self.timings!r}: must be a timing, such as AllTogether(0.75)")
            if not isinstance(self.frustum, Frustum | None):
                raise ScenarioError(f"frustum={self.frustum!r}: must be a Frustum or None")
            set_checked(self, camera=check_cameras)
            try:
                self.timings.windows([(each.id, path_of(each)) for each in self.objects])
            except ValueError as error:
                raise ScenarioError(f"timings: {error}") from error
            set_checked(self, edits=check_edits)
            spawned = [each.object for each in self.edits if isinstance(each, Spawn)]
            every = [*self.objects, *spawned]
            object.__setattr__(self, "joints", check_joints(self.joints, every))
            object.__setattr__(self, "filtered_pairs", check_filtered_pairs(self.filtered_pairs, every))
            set_checked(self, lights=check_lights, variants=check_variants, overrides=check_overrides)
            set_checked(self, exposure_compensation=number)
            if abs(self.exposure_compensation) > MAX_STOPS:
                raise ScenarioError(
                    f"exposure_compensation={self.exposure_compensation!r}: must be from -{MAX_STOPS:g} to "
                    f"{MAX_STOPS:g} stops"
                )
            self.log()

    def log(self) -> EditLog:
        """Return the edit log: the histories of all objects, to which further edits can be added."""
        return EditLog(self.objects, self.edits)

    @property
    def cameras(self) -> tuple[Camera | str | None, ...]:
        """The cameras, the main one first; None stands for the stage's own."""
        return self.camera if isinstance(self.camera, tuple) else (self.camera,)

    @property
    def moved_prims(self) -> tuple[str, ...]:
        """Paths of the prims of the stage that are objects of the scenario, sorted."""
        return tuple(sorted({each.template for each in self.objects if catalog.is_prim_path(each.template)}))

    @classmethod
    def sample(
        cls,
        scene: str | os.PathLike[str],
        *,
        seed: int = 0,
        camera: Camera | str | None = None,
        objects: WholeRange = (1, 3),
        templates: Sequence[str] | None = None,
        dynamics: Sequence[str] = ("catmull",),
        speed: Range = (0.2, 0.8),
        angular_speed: Range = (0.0, 0.8),
        waypoints: WholeRange = (3, 5),
        scale: Range = (1.0, 1.0),
        depth: Range = (1.0, 5.0),
        region: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0),
        in_view: Range = (1.0, 1.0),
        occlusion: Range = (0.0, 0.0),
        min_size: float = 0.03,
        frames: int | None = None,
        life: WholeRange | None = None,
        wait_time: float = 0.0,
        aspect: float = 4.0 / 3.0,
        clutter: Any = None,
        furniture: Any = None,
        views: Any = None,
        illumination: Any = None,
        materials: Any = None,
        difficulty: Mapping[str, Any] | None = None,
        variants: Mapping[str, str] | None = None,
    ) -> Scenario:
        """Draw a random scenario; the same arguments give the same scenario.

        Every quantity of every object has random numbers of its own: one more object, or another range of speeds,
        changes nothing else. A range is (low, high), both included, or one number. `clutter` to `materials` are factors
        as of `with_factor`, drawn after the objects, which keep their places: True for typical ranges, or a value.

        Args:
            scene: name or file of the scene.
            seed: 0 to 2^64 - 1.
            camera: the camera of the scenario. `depth`, `region`, `in_view` and `occlusion` refer to its pose at the
                start.
            objects: number of objects.
            templates: names or files to draw from; None: the whole catalog.
            dynamics: kinds of trajectory to draw from: "still", "linear", "catmull" (closed loops), "bounce".
            speed: m/s, along the whole loop.
            angular_speed: rad/s, about a random axis of the object.
            waypoints: number of waypoints of a loop.
            scale: scale factor of an object.
            depth: distance from the camera along its axis, m.
            region: left, top, right and bottom of the part of the image, 0..1, in which waypoints lie.
            in_view: fraction of its path during which an object's center is in view.
            occlusion: fraction of the path in view during which its center is hidden by the scene.
            min_size: least size of an object while its center is in view, as a fraction of the image's height: the
                diameter of the disk whose area is that of the object's convex silhouette, averaged over all
                directions. It bounds the depth of small objects. Of a bouncing object, at its start.
            frames: length of the stream; needed for `life`.
            life: number of frames for which an object is alive, from a random one on; None: always.
            wait_time: time until all objects start, s.
            aspect: width / height of the view.
            clutter: distractors, that rest in view: their number, or ranges.
            furniture: movable objects of the scene elsewhere, and in other variants.
            views: another pose or lens of the camera.
            illumination: time of day; strength, color and direction of lights; exposure.
            materials: other colors, roughness and textures.
            difficulty: bands of the mean of measures of `Frame.difficulty`, {"motion": (1, 3)}, of images 128 px wide.
                Scenarios are drawn until one lies within them. Speeds may be multiplied for `motion`.
            variants: variant selections of the scene, `{"/Room{lighting}": "night"}`.

        Raises:
            ArgumentError: the ranges contradict themselves.
            ScenarioError: nothing in the scene fits the ranges.
        """
        ranges = {name: value for name, value in locals().items() if name not in ("cls", "scene", "seed", "camera")}
        bands = ranges.pop("difficulty")
        if bands is not None:

            def draw(number: int) -> Scenario:
                return cls.sample(scene, seed=number, camera=camera, **ranges)

            drawn: Scenario = provider("sample_difficulty")(draw, bands, seed=seed, frames=frames, aspect=aspect)
            return drawn
        factors = {name: ranges.pop(name) for name in DRAWN_FACTORS}
        scenario: Scenario = provider("sample")(scene, seed=seed, camera=camera, **ranges)
        for name, value in factors.items():
            if value is not None and value is not False:
                scenario = scenario.with_factor(name, None if value is True else value, seed=seed)
        return scenario

    def with_factor(self, factor: str, value: Any = None, *, seed: int = 0) -> Scenario:
        """Return the scenario with one factor of variation drawn anew, and everything else as it is: a counterfactual.

        Args:
            factor: one of `tiscene.randomization.factors.FACTORS`, such as "illumination", "furniture" or "speed".
            value: its value or ranges; None: typical ranges.
            seed: 0 to 2^64 - 1. Each factor has random numbers of its own.

        Raises:
            UnknownName: there is no such factor.
            ArgumentError: the value is wrong.
            ScenarioError: the scenario cannot have it.
        """
        scenario: Scenario = provider("with_factor")(self, factor, value, seed=seed)
        return scenario

    def to_json(self) -> dict[str, Any]:
        """Return the scenario as JSON values, from which `from_json` makes the same scenario, to the bit."""
        content: dict[str, Any] = serialization.encode(self, FIELDS, SCENARIOS)
        return {"format": FORMAT, "version": VERSION} | content

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Scenario:
        """Make a scenario from JSON values.

        Raises:
            ScenarioError: a value is wrong; the message names its place.
        """
        if not isinstance(content, Mapping) or content.get("format") != FORMAT:
            raise ScenarioError(f'not a scenario: it should be an object with "format": "{FORMAT}"')
        if content.get("version") != VERSION:
            raise ScenarioError(f"version: {content.get('version')!r}, but this tiscene reads version {VERSION}")
        members = {key: value for key, value in content.items() if key not in ("format", "version")}
        scenario: Scenario = serialization.decode(members, FIELDS, SCENARIOS)
        return scenario

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the scenario as JSON (.json), or as a USD layer over the scene (.usda, .usdc, .usd).

        The layer shows the scenario's start in any USD program and holds the scenario by the schema in
        `tiscene.usd.core.schema`. It refers to the files of the scene and of the templates.

        Raises:
            ArgumentError: another suffix.
            ScenarioError: the scenario holds something that a file cannot.
            ExportError: the file cannot be written.
        """
        if not isinstance(path, str | os.PathLike):
            raise ArgumentError(f"path={path!r}: must be the name of a file")
        path = Path(path)
        content = self.to_json()
        if path.suffix.lower() == ".json":
            serialization.write(path, content)
            return
        if path.suffix.lower() not in catalog.LAYER_SUFFIXES:
            suffixes = ", ".join((".json", *catalog.LAYER_SUFFIXES))
            raise ArgumentError(f"path={str(path)!r}: a scenario is saved as a file that ends in {suffixes}")
        provider("write_usd")(content, path)

    @classmethod
    def load(
        cls,
        source: str | os.PathLike[str],
        *,
        variants: Mapping[str, str] | None = None,
        still: bool = False,
        limits: Any = None,
        camera: Camera | str | Sequence[Camera | str] | None = None,
    ) -> Scenario:
        """Read a scenario file, or the scenario that is authored on a USD stage.

        Args:
            source: a scenario (.json), a USD file, or a scene's name. A stage on which nothing moves is a scenario
                without objects. Relative paths in a .json file count from its folder, or from the working directory
                if no file is there.
            variants: variant selections, added to those in the file.
            still: read no motion from a stage.
            limits: `ts.Limits` of time and memory that reading a stage may take; None: unlimited.
            camera: a camera, or several, in place of the source's; one that is named moves as it does on the stage.

        Raises:
            ArgumentError, MissingFile, SceneNotFound: there is no such source.
            StageError: the stage cannot be read.
            ScenarioError: the scenario is invalid; the message names the file and the place in it.
        """
        if not isinstance(source, str | os.PathLike):
            raise ArgumentError(f"source={brief(source)}: must be a Scenario, a scene's name or a file")
        if Path(source).suffix.lower() == ".json":
            folder = Path(source).parent
            loaded = serialization.read(source, lambda content: cls.from_json(from_folder(content, folder)))
            loaded = replace(loaded, variants={**loaded.variants, **variants}) if variants else loaded
            return loaded if camera is None else replace(loaded, camera=camera)
        if still:
            return cls(os.fspath(source), variants=dict(variants or {}), camera=camera)
        file = catalog.find_scene(source)
        authored = provider("read_usd")(file, variants=variants, limits=limits)
        content = {"format": FORMAT, "version": VERSION, "scene": os.fspath(source)} | authored.content
        content["variants"] = content.get("variants", {}) | dict(variants or {})
        try:
            loaded = cls.from_json(content)
            if camera is None:
                return loaded
            cameras = check_cameras(camera, "camera")
            moving = {name: cls.from_json(content | {"camera": each}).camera for name, each in authored.cameras.items()}
            if isinstance(cameras, tuple):
                return replace(loaded, camera=tuple(_played(each, moving) for each in cameras))
            return replace(loaded, camera=_played(cameras, moving))
        except ScenarioError as error:
            row = re.match(r"objects\[(\d+)\]", str(error))
            prim = f"<{authored.prim_paths[int(row.group(1))]}> " if row else ""
            raise ScenarioError(f"{file}: {prim}{error}") from error


SCENARIOS = classes(Scenario)


def _played(camera: Camera | str, moving: Mapping[str, Any]) -> Camera | str:
    """Return a camera as it moves on the stage, if it is named and moves."""
    return moving.get(camera, camera) if isinstance(camera, str) else camera
