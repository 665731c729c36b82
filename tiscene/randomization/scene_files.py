# SPDX-License-Identifier: Apache-2.0
"""Scenes and templates that scenarios are drawn for; those read last are kept."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from dynamics import Body, Simulation
from tiscene import catalog
from tiscene.device import runtime
from tiscene.randomization.free_space import FreeSpace
from tiscene.randomization.scene_collisions import SceneCollisions
from tiscene.scenario.overrides import CameraOverride, ObjectOverride
from tiscene.scenario.scenario import Scenario
from tiscene.scene.camera import Camera
from tiscene.scene.description import SceneDescription
from tiscene.usd.core.layers import cached_by_layers
from tiscene.usd.read.inspection import stage_facts
from tiscene.usd.read.kept_templates import kept_template
from tiscene.usd.read.stage_reader import read_stage
from tiscene.world.overridden_stage import overridden

KEPT = 4


def stage_of(scenario: Scenario) -> SceneDescription:
    """Return the stage of a scenario with its variants, as authored: without overrides.

    The prims that the scenario moves are not part of it, but templates.

    Raises:
        SceneNotFound, MissingFile, StageError: it cannot be read.
        UnknownName: it does not have a prim that the scenario moves.
    """
    return _stage(*_reading(scenario))


def variant_sets_of(scenario: Scenario) -> Mapping[str, tuple[str, tuple[str, ...]]]:
    """Return the variant sets of a scenario's stage: {"/Prim{set}": (selected by the stage, all variants)}."""
    return _variant_sets(catalog.find_scene(scenario.scene))


def templates_of(scenario: Scenario) -> dict[str, SceneDescription]:
    """Return the templates of a scenario's objects by name, in the order of first use.

    Raises:
        TemplateNotFound, MissingFile, StageError: one cannot be read.
    """
    stage = stage_of(scenario)
    own = {template.name: template.description for template in stage.templates}
    names = dict.fromkeys(each.template for each in scenario.objects)
    return {name: own[name] if name in own else template_of(name, stage.up_axis) for name in names}


def main_camera_of(scenario: Scenario) -> Camera:
    """Return the main camera of a scenario, with its overrides, where it is at frame 0. Taichi must be running.

    Raises:
        CameraNotFound: the stage has no such camera.
    """
    camera = scenario.cameras[0]
    if not isinstance(camera, Camera):
        overrides = [each for each in scenario.overrides if isinstance(each, CameraOverride)]
        camera = overridden(stage_of(scenario), overrides).camera(camera)
    camera = camera.at(0.0)
    if camera.dynamic is None:
        return camera
    x, y, z, *rotation = Simulation([Body(camera.dynamic, camera.position, camera.rotation)]).poses(0)[0].tolist()
    return camera.with_pose((x, y, z), tuple(rotation))


def free_space_of(scenario: Scenario, camera: Camera | None = None, aspect: float = 4.0 / 3.0) -> FreeSpace:
    """Return the free space of a scenario's stage, with its overrides, before a camera.

    Args:
        scenario: the scenario.
        camera: the camera; None: the main camera.
        aspect: width / height of its image.
    """
    runtime.start()
    camera = camera or main_camera_of(scenario)
    return _free_space(*_reading(scenario), _moved(scenario), camera, aspect, runtime.session())


def collisions_of(scenario: Scenario) -> SceneCollisions:
    """Return the collisions with a scenario's stage, with its overrides. They are kept: leave its objects in place."""
    runtime.start()
    return _collisions(*_reading(scenario), _moved(scenario), runtime.session())


def _moved(scenario: Scenario) -> tuple[ObjectOverride, ...]:
    return tuple(each for each in scenario.overrides if isinstance(each, ObjectOverride))


def _reading(scenario: Scenario) -> tuple[Path, str, tuple[str, ...]]:
    """Return the file of a scenario's stage, its variants as JSON, and the prims that are left out of the scene."""
    return catalog.find_scene(scenario.scene), json.dumps(scenario.variants, sort_keys=True), scenario.moved_prims


# A restart of Taichi destroys the arrays of what was kept, so its session is an argument.
@cached_by_layers(KEPT)
def _free_space(
    file: Path,
    variants: str,
    extract: tuple[str, ...],
    moved: tuple[ObjectOverride, ...],
    camera: Camera,
    aspect: float,
    session: object,
) -> FreeSpace:
    return FreeSpace(overridden(_stage(file, variants, extract), moved), camera, aspect)


@cached_by_layers(KEPT)
def _collisions(
    file: Path, variants: str, extract: tuple[str, ...], moved: tuple[ObjectOverride, ...], session: object
) -> SceneCollisions:
    return SceneCollisions(overridden(_stage(file, variants, extract), moved))


@cached_by_layers(KEPT)
def _stage(file: Path, variants: str, extract: tuple[str, ...]) -> SceneDescription:
    return read_stage(file, variants=json.loads(variants) or None, extract=extract)


@cached_by_layers(KEPT)
def _variant_sets(file: Path) -> Mapping[str, tuple[str, tuple[str, ...]]]:
    return stage_facts(file).variants


def template_of(name: str, up_axis: str) -> SceneDescription:
    """Return a template of the catalog, or of a file, for a stage of an up axis."""
    file, variants = catalog.find_template(name), catalog.template_variants(name)[1]
    return kept_template(file, up_axis="Z" if up_axis == "Z" else "Y", variants=variants).description
