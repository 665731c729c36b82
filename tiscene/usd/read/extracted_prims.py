# SPDX-License-Identifier: Apache-2.0
"""Objects of a stage that a scenario moves: left out of the static scene and read as templates of their own."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from tiscene.errors import TemplateNotFound
from tiscene.scene.description import Matrix, SceneDescription, Template
from tiscene.usd.core.pose import pose_matrix, read_pose
from tiscene.usd.core.prims import ancestors, renders
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import asset_name, inherited_label, name_label
from tiscene.usd.core.time_samples import NOT_ANIMATED, transformed
from tiscene.usd.core.units import Units
from tiscene.usd.core.value_times import is_time_varying
from tiscene.usd.read.template import NOTHING_DRAWN, as_template
from tiscene.usd.read.traversal import StageReader
from tiscene.usd.read.traversal_context import TraversalContext


class RemainderReader(StageReader):
    """Reads a stage without some of its prims and their descendants, except cameras and prototypes of instancers."""

    def __init__(
        self,
        stage: Usd.Stage,
        time: Usd.TimeCode,
        report: StageReport,
        extract: Collection[str],
        taxonomy: str | None,
    ) -> None:
        """Start with an empty description. `extract`: paths of the prims to leave out; others as of StageReader."""
        super().__init__(stage, time, report, taxonomy)
        self._extracted = frozenset(extract)

    def _read(self, prim: Usd.Prim, here: TraversalContext) -> bool:
        in_prototype = self._parts is not None
        if in_prototype or not any(str(path) in self._extracted for path in prim.GetPath().GetPrefixes()):
            return super()._read(prim, here)
        if prim.IsA(UsdGeom.Camera):  # no template holds it
            self._read_camera(prim, here)
        return not prim.IsA(UsdGeom.PointInstancer)


class _ExtractedReader(StageReader):
    """Reads one prim as if it were visible. Its animated visibility is the lifespan of a scenario's object."""

    def __init__(self, root: Usd.Prim, time: Usd.TimeCode, report: StageReport, taxonomy: str | None) -> None:
        super().__init__(root.GetStage(), time, report, taxonomy)
        self._extracted_path = root.GetPath()

    def _enter(self, prim: Usd.Prim, inherited: TraversalContext) -> TraversalContext:
        here = super()._enter(prim, inherited)
        return replace(here, visible=True) if prim.GetPath() == self._extracted_path else here


def extracted_templates(
    stage: Usd.Stage, extract: Collection[str], time: Usd.TimeCode, report: StageReport, taxonomy: str | None
) -> list[tuple[Template, NDArray[np.float64]]]:
    """Read each extracted prim as a template that is named by its path, and return it with its box in the world.

    The template has the axes of the prim's pose, and keeps its scale. The box is [2, 3], m.

    Args:
        stage: the stage.
        extract: paths of the prims.
        time: time code to read at.
        report: receives problems and omissions.
        taxonomy: taxonomy of the labels; None: the preferred ones.

    Raises:
        TemplateNotFound: there is no transformable prim at a path.
    """
    return [_template(stage, path, time, report, taxonomy) for path in sorted(set(extract))]


def _template(
    stage: Usd.Stage, path: str, time: Usd.TimeCode, report: StageReport, taxonomy: str | None
) -> tuple[Template, NDArray[np.float64]]:
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if not prim or not prim.IsA(UsdGeom.Xformable):
        paths = [str(each.GetPath()) for each in stage.Traverse() if each.IsA(UsdGeom.Xformable)]
        raise TemplateNotFound("prim", path, paths, " to move on the stage")
    pose = read_pose(prim, time, Units.of(stage))
    reader = _ExtractedReader(prim, time, report, taxonomy)
    parent_world = UsdGeom.Xformable(prim).ComputeParentToWorldTransform(time)
    label = inherited_label(prim, time, taxonomy)
    animated = NOT_ANIMATED
    groups = [each for each in ancestors(prim) if each.IsA(UsdGeom.Imageable)]
    for group in reversed(groups):  # a group may appear and vanish with all objects in it
        if report.reads_animation and is_time_varying(UsdGeom.Imageable(group).GetVisibilityAttr()):
            animated = animated.hidden_by(group)
    reader.walk(prim, TraversalContext(parent_world, renders=renders(prim), label=label, animated=animated))
    description = reader.description(path)
    box = description.bounds()
    if isinstance(pose, str):
        report.problem(path, "transform", pose)
    else:
        inverse = np.linalg.inv(pose_matrix(pose.position, pose.rotation))
        description = _transformed(description, np.asarray(inverse, np.float64))
    label = name_label(prim) if reader.by_name else label
    if not description.instances and not report.omits(path):
        report.problem(path, "template", NOTHING_DRAWN)
    return as_template(description, prim, label, asset_name(prim)), box


def _transformed(description: SceneDescription, by: Matrix) -> SceneDescription:
    """Return a description with its instances, colliders and lights multiplied from the left by a rigid 4x4 matrix."""
    return replace(
        description,
        instances=tuple(replace(each, world_from_object=by @ each.world_from_object) for each in description.instances),
        colliders=tuple(replace(each, world_from_object=by @ each.world_from_object) for each in description.colliders),
        tracks=transformed(description.tracks, by),
        lights=tuple(replace(each, world_from_light=by @ each.world_from_light) for each in description.lights),
        light_tracks=tuple(
            each.mapped("world_from_light", lambda pose: by @ pose) for each in description.light_tracks
        ),
    )
