# SPDX-License-Identifier: Apache-2.0
"""Things of a stage that are to move: taken out of what stands still, and made templates of."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from tiscene.errors import TemplateNotFound
from tiscene.scene.assembly import as_one
from tiscene.scene.description import Template
from tiscene.usd.core.pose import pose_matrix, read_pose
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import asset_name, inherited_label, name_label
from tiscene.usd.core.time_samples import NOT_ANIMATED, transformed
from tiscene.usd.core.units import Units
from tiscene.usd.read.traversal import StageReader, TraversalContext


class RemainderReader(StageReader):
    """Reads a stage without some of its prims and all below them."""

    def __init__(
        self,
        stage: Usd.Stage,
        time: Usd.TimeCode,
        report: StageReport,
        extract: Collection[str],
        taxonomy: str | None = None,
    ) -> None:
        super().__init__(stage, time, report, taxonomy)
        self._extracted = frozenset(extract)

    def _read(self, prim: Usd.Prim, here: TraversalContext, predicate: Any) -> bool:
        return str(prim.GetPath()) not in self._extracted and super()._read(prim, here, predicate)


class _ExtractedReader(StageReader):
    """Reads one prim as if it were visible: when it is seen is a matter of its life span."""

    def __init__(self, root: Usd.Prim, time: Usd.TimeCode, report: StageReport, taxonomy: str | None) -> None:
        super().__init__(root.GetStage(), time, report, taxonomy)
        self._root = root.GetPath()

    def _enter(self, prim: Usd.Prim, above: TraversalContext) -> TraversalContext:
        here = super()._enter(prim, above)
        return replace(here, visible=True) if prim.GetPath() == self._root else here


def extracted_templates(
    stage: Usd.Stage, extract: Collection[str], time: Usd.TimeCode, report: StageReport, taxonomy: str | None = None
) -> tuple[Template, ...]:
    """A template of each prim, its name the prim's path. It has the axes of the prim's pose, and keeps its scale.

    Raises TemplateNotFound for a path where no prim is that can be pose_matrix.
    """
    return tuple(_template(stage, path, time, report, taxonomy) for path in sorted(set(extract)))


def _template(stage: Usd.Stage, path: str, time: Usd.TimeCode, report: StageReport, taxonomy: str | None) -> Template:
    prim = stage.GetPrimAtPath(path) if Sdf.Path.IsValidPathString(path) else None
    if not prim or not prim.IsA(UsdGeom.Xformable):
        things = [str(each.GetPath()) for each in stage.Traverse() if each.IsA(UsdGeom.Xformable)]
        raise TemplateNotFound("prim", path, things, " to move on the stage")
    pose = read_pose(prim, time, Units.of(stage))
    reader = _ExtractedReader(prim, time, report, taxonomy)
    above = UsdGeom.Xformable(prim).ComputeParentToWorldTransform(time)
    # Its label may be inherited.
    label = inherited_label(prim, time, taxonomy)
    inherited = NOT_ANIMATED
    for parent in reversed(list(_parents(prim))):  # a group may come and go with all that is in it
        hides = report.reads_animation and UsdGeom.Imageable(parent).GetVisibilityAttr().ValueMightBeTimeVarying()
        inherited = replace(inherited, hiders=(*inherited.hiders, parent)) if hides else inherited
    reader.walk(prim, TraversalContext(above, label=label, inherited=inherited))
    description = reader.description(path)
    if isinstance(pose, str):
        report.problem(path, "transform", pose)
    else:
        own = np.linalg.inv(pose_matrix(pose.position, pose.rotation))
        instances, colliders = (
            tuple(replace(each, world_from_object=own @ each.world_from_object) for each in description.instances),
            tuple(replace(each, world_from_object=own @ each.world_from_object) for each in description.colliders),
        )
        tracks = transformed(description.tracks, np.asarray(own, np.float64))
        description = replace(description, instances=instances, colliders=colliders, tracks=tracks)
    if not description.instances:
        report.problem(path, "template", "it holds no geometry that would be drawn")
    category = next((thing.category for thing in description.objects if thing.category), "")
    category = name_label(prim) if reader.by_name else label or category
    return Template(path, category, as_one(description, prim.GetName(), path, category, asset_name(prim)))


def _parents(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """What a prim is in, from its parent on, as far as it can be seen."""
    while (prim := prim.GetParent()) and prim.IsA(UsdGeom.Imageable):
        yield prim
