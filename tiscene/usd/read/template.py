# SPDX-License-Identifier: Apache-2.0
"""Object templates: what can be spawned. From files of their own, or from the class prim "Templates" of a stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pxr import Gf, Usd, UsdGeom

from tiscene.errors import StageError
from tiscene.scene.assembly import as_one
from tiscene.scene.description import Template
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import asset_name, inherited_label, name_label, readable_name, spaced
from tiscene.usd.core.stage import open_stage, quiet, readable, reading_time, select_variants
from tiscene.usd.geometry.skinning import bake_skinning
from tiscene.usd.read.traversal import UNDEFINED_TOO, Context, StageReader

TEMPLATES_PRIM = "/Templates"


def read_template(
    path: str | Path,
    *,
    up_axis: Literal["Y", "Z"] | None = None,
    variants: Mapping[str, str] | None = None,
    taxonomy: str | None = None,
) -> Template:
    """Read the default prim of a file (else its only root prim) as a template.

    Its origin is that of the default prim, wherever the file has placed it; rotation and scale stay. up_axis: turn
    the template so that its up is this axis; None leaves it in the axes of its file. The name is the prim's
    displayName, else made from the file's name; the category is the prim's label, else its first labeled part's, else
    what its name says. taxonomy: of the labels; None for "class", else "category", else any. variants: what to select
    of the prim's variant sets, `{"color": "walnut"}`.

    Raises MissingFile, StageError and UnknownName (variants); what is left out is named in one StageWarning.
    """
    with quiet(), readable(path):
        stage = open_stage(path)
        report = StageReport(str(path))
        prim = root_prim(stage)
        if prim is None:
            raise StageError(
                str(path), ["</> template: the file has no default prim, so that it is unclear what to spawn"]
            )
        if variants:
            select_variants(stage, {str(prim.GetPath()): variants})
        bake_skinning(stage, reading_time(stage, None), report)
        template = template_of(prim, display_name(prim) or readable_name(Path(path)), report, up_axis, taxonomy)
        report.raise_problems()
    report.warn()
    return _with_materials_named(template, str(prim.GetPath()))


def _with_materials_named(template: Template, prim_path: str) -> Template:
    """Materials of files in one world are told apart: "/Chair01/Looks/Oak" is "Chair 01/Looks/Oak"."""
    materials = tuple(
        replace(each, prim_path=template.name + each.prim_path.removeprefix(prim_path)) if each.prim_path else each
        for each in template.description.materials
    )
    return replace(template, description=replace(template.description, materials=materials))


def root_prim(stage: Usd.Stage) -> Usd.Prim | None:
    """What a file is about: its default prim, else its only root prim that can be drawn."""
    if stage.GetDefaultPrim():
        return stage.GetDefaultPrim()
    roots = [child for child in stage.GetPseudoRoot().GetChildren() if child.IsA(UsdGeom.Imageable)]
    return roots[0] if len(roots) == 1 else None


def stage_templates(stage: Usd.Stage, report: StageReport, taxonomy: str | None = None) -> tuple[Template, ...]:
    """The children of the class prim "Templates" at the root of a stage."""
    folder = stage.GetPrimAtPath(TEMPLATES_PRIM)
    if not folder or not folder.IsAbstract():
        return ()
    children = folder.GetFilteredChildren(UNDEFINED_TOO)
    return tuple(
        template_of(child, display_name(child) or spaced(child.GetName()), report, taxonomy=taxonomy)
        for child in children
    )


def template_of(
    prim: Usd.Prim, name: str, report: StageReport, up_axis: str | None = None, taxonomy: str | None = None
) -> Template:
    """A prim and all below it as a template; a problem if nothing of it draws."""
    stage = prim.GetStage()
    time = reading_time(stage, None)
    reader = StageReader(stage, time, report, taxonomy)
    world = Gf.Matrix4d(1.0)
    if prim.IsA(UsdGeom.Xformable):
        placed = UsdGeom.Xformable(prim).GetLocalTransformation(time).ExtractTranslation()
        world.SetTranslate(-placed)
    if up_axis is not None and up_axis != reader.up_axis:
        turn = Gf.Rotation(Gf.Vec3d(1, 0, 0), -90.0 if up_axis == "Y" else 90.0)
        world = world * Gf.Matrix4d(1.0).SetRotate(turn)
        reader.up_axis = "Y" if up_axis == "Y" else "Z"
    label = name_label(prim) if reader.by_name else inherited_label(prim, time, taxonomy)
    reader.walk(prim, Context(world), UNDEFINED_TOO)
    description = reader.description(name)
    if not description.instances:
        report.problem(prim.GetPath(), "template", "it holds no geometry that would be drawn")
    category = label or next((thing.category for thing in description.objects if thing.category), "")
    whole = as_one(description, prim.GetName(), str(prim.GetPath()), category, asset_name(prim) or name)
    return Template(name, category, whole)


def display_name(prim: Usd.Prim) -> str:
    """The displayName metadata of a prim, "" for none."""
    return str(prim.GetDisplayName() or "")
