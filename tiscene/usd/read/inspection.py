# SPDX-License-Identifier: Apache-2.0
"""stage_facts: metadata and statistics of a USD file, for `tiscene inspect`, without building a scene."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pxr import Usd, UsdGeom

from tiscene.usd.core import schema
from tiscene.usd.core.limits import RootFolder
from tiscene.usd.core.prims import with_ancestors
from tiscene.usd.core.semantics import taxonomies_of
from tiscene.usd.core.stage import Variants, open_stage, quiet, readable
from tiscene.usd.core.value_times import has_spline
from tiscene.usd.read.object_builder import is_rigid_body


@dataclass(frozen=True)
class StageFacts:
    """Metadata and statistics of a stage.

    Attributes:
        layers: files of all layers.
        types: number of prims of each type; those in a prototype count once per instance.
        variants: {"/Prim{set}": (selected variant, all variants)}.
        taxonomies: taxonomies of the semantic labels.
        meters_per_unit: meters per stage unit.
        unit_is_authored: False: `meters_per_unit` is USD's default, 0.01.
        up_axis: "Y" or "Z".
        other_units: layers that author another unit or up axis, as "/assets/chair.usd (0.01 m per unit, Z up)". USD
            composes them as if they were in those of the stage.
        time_codes: first and last, None if not authored.
        time_codes_per_second: rate of time codes.
        animated: number of prims with time samples.
        instances: number of native instances.
        unauthored_schemes: number of meshes without an authored subdivisionScheme, which are smooth surfaces.
        still_bodies: number of rigid bodies that no scenario of the stage moves.
        license: license texts that `tiscene import` has kept, by file name.
    """

    layers: tuple[str, ...]
    types: dict[str, int]
    variants: dict[str, tuple[str, tuple[str, ...]]]
    taxonomies: tuple[str, ...]
    meters_per_unit: float
    unit_is_authored: bool
    up_axis: str
    other_units: tuple[str, ...]
    time_codes: tuple[float, float] | None
    time_codes_per_second: float
    animated: int
    instances: int
    unauthored_schemes: int
    still_bodies: int
    license: dict[str, str]


def stage_facts(path: str | Path, variants: Variants | None = None, root: str | Path | None = None) -> StageFacts:
    """Read the facts of a stage.

    Args:
        path: the file.
        variants: variant selections, `{"/Room{lighting}": "night"}`.
        root: folder that all files must be in; None: no restriction.

    Raises:
        MissingFile, StageError, UnknownName (variants): the stage cannot be opened.
    """
    with quiet(), readable(path):
        stage = open_stage(path, variants)
        RootFolder(root).check(stage, str(path))
        prims = list(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
        sets = {}
        for prim in stage.Traverse():
            for name in prim.GetVariantSets().GetNames() if prim.HasVariantSets() else ():
                choice = prim.GetVariantSets().GetVariantSet(name)
                sets[f"{prim.GetPath()}{{{name}}}"] = (choice.GetVariantSelection(), tuple(choice.GetVariantNames()))
        root_layer = stage.GetRootLayer()
        has_range = root_layer.HasStartTimeCode() and root_layer.HasEndTimeCode()
        kept = root_layer.customLayerData.get("import", {})
        return StageFacts(
            layers=tuple(sorted(layer.realPath for layer in stage.GetUsedLayers() if not layer.anonymous)),
            types=dict(Counter(str(prim.GetTypeName()) or "(no type)" for prim in prims).most_common()),
            variants=sets,
            taxonomies=tuple(sorted(taxonomies_of(stage))),
            meters_per_unit=float(UsdGeom.GetStageMetersPerUnit(stage)),
            unit_is_authored=UsdGeom.StageHasAuthoredMetersPerUnit(stage),
            up_axis=str(UsdGeom.GetStageUpAxis(stage)),
            other_units=tuple(sorted(_other_units(stage))),
            time_codes=(stage.GetStartTimeCode(), stage.GetEndTimeCode()) if has_range else None,
            time_codes_per_second=stage.GetTimeCodesPerSecond(),
            animated=sum(
                any(a.GetNumTimeSamples() > 1 or has_spline(a) for a in prim.GetAuthoredAttributes()) for prim in prims
            ),
            instances=sum(bool(prim.IsInstance()) for prim in prims),
            unauthored_schemes=sum(
                prim.IsA(UsdGeom.Mesh) and not UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr().HasAuthoredValue()
                for prim in prims
            ),
            still_bodies=sum(map(_is_still_body, prims)),
            license={str(key): str(value) for key, value in kept.items()} if isinstance(kept, dict) else {},
        )


def _is_still_body(prim: Usd.Prim) -> bool:
    """Return whether a prim is a rigid body that stands still, since it is not, nor is in, an object of a scenario."""
    if not is_rigid_body(prim):
        return False
    return not any(schema.has(each, schema.OBJECT, schema.MOTION) for each in with_ancestors(prim))


def _other_units(stage: Usd.Stage) -> Iterator[str]:
    """Yield the layers that author another unit or up axis than the stage has, see `StageFacts.other_units`."""
    own = {"metersPerUnit": UsdGeom.GetStageMetersPerUnit(stage), "upAxis": UsdGeom.GetStageUpAxis(stage)}
    for layer in stage.GetUsedLayers():
        root = layer.pseudoRoot
        units = {name: root.GetInfo(name) if root.HasInfo(name) else value for name, value in own.items()}
        if units != own and not layer.anonymous:
            yield f"{layer.realPath} ({units['metersPerUnit']:g} m per unit, {units['upAxis']} up)"
