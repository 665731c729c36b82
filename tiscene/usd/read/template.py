# SPDX-License-Identifier: Apache-2.0
"""Object templates, which can be spawned: from files of their own, or from the class prim /Templates of a stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

from pxr import Gf, Usd, UsdGeom

from tiscene.errors import StageError
from tiscene.scene.assembly import as_one
from tiscene.scene.description import SceneDescription, Template
from tiscene.usd.core.limits import Limits, RootFolder
from tiscene.usd.core.prims import ALSO_ABSTRACT
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import asset_name, inherited_label, name_label, readable_name, spaced
from tiscene.usd.core.stage import open_stage, quiet, readable, reading_time, select_variants
from tiscene.usd.geometry.draw_modes import apply_draw_modes
from tiscene.usd.geometry.skinning import prepare_skinning
from tiscene.usd.geometry.subdivision_budget import DEFAULT_TRIANGLES, limit_subdivision
from tiscene.usd.read.subprocess_reader import read_in_subprocess
from tiscene.usd.read.traversal import StageReader
from tiscene.usd.read.traversal_context import TraversalContext

TEMPLATES_PRIM = "/Templates"
NOTHING_DRAWN = "it holds no geometry that would be drawn"  # problem of a template


def read_template(
    path: str | Path,
    *,
    up_axis: Literal["Y", "Z"] | None = None,
    variants: Mapping[str, str] | None = None,
    taxonomy: str | None = None,
    limits: Limits | None = None,
    root: str | Path | None = None,
) -> Template:
    """Read the default prim of a file, else its only root prim, as a template.

    The template's origin is that of the prim: its translation is dropped, its rotation and scale are kept. The name is
    the prim's displayName, else derived from the file name. The category is the prim's label, else the label of its
    first labeled part, else derived from the prim's name.

    Args:
        path: the file.
        up_axis: turn the template so that this axis is up; None: keep the axes of the file.
        variants: selections of the prim's variant sets, `{"color": "walnut"}`.
        taxonomy: taxonomy of the labels; None: "class", else "category", else any.
        limits: upper bounds of time and memory. With them the file is read in a child process; None: in this process,
            without bounds.
        root: folder that all files must be in; None: no restriction.

    Raises:
        MissingFile: there is no such file.
        StageError: the file is not a template (lists every problem found), not within `root`, or a limit is exceeded.
        UnknownName: a variant that the prim does not have.

    Content that is left out or approximated is listed in one StageWarning.
    """
    if limits is not None:
        options = {"up_axis": up_axis, "variants": variants, "taxonomy": taxonomy, "root": root}
        return read_in_subprocess(read_template, path, options, limits)
    template, report = template_and_report(path, up_axis, variants, taxonomy, root)
    report.warn()
    return template


def template_and_report(
    path: str | Path,
    up_axis: Literal["Y", "Z"] | None,
    variants: Mapping[str, str] | None,
    taxonomy: str | None,
    root: str | Path | None = None,
) -> tuple[Template, StageReport]:
    """Read a template in this process; return it, and what was left out of it. See `read_template`."""
    root_folder = RootFolder(root)
    with quiet(), readable(path):
        report = StageReport(str(path), root=root_folder)
        stage = open_stage(path, report=report)
        root_folder.check(stage, str(path))
        prim = root_prim(stage)
        if prim is None:
            raise StageError(
                str(path), ["</> template: the file has no default prim, so that it is unclear what to spawn"]
            )
        if variants:
            select_variants(stage, {str(prim.GetPath()): variants})
        time = reading_time(stage, None)
        apply_draw_modes(stage, time, report)
        prepare_skinning(stage, time, report)
        limit_subdivision(stage, time, DEFAULT_TRIANGLES, report)
        template = template_of(prim, display_name(prim) or readable_name(Path(path)), report, up_axis, taxonomy)
        root_folder.check(stage, str(path))
        report.raise_problems(anything_left=bool(template.description.instances))
    return _with_unique_materials(template, str(prim.GetPath())), report


def _with_unique_materials(template: Template, prim_path: str) -> Template:
    """Prefix material paths by the template's name: "/Chair01/Looks/Oak" becomes "Chair 01/Looks/Oak"."""
    materials = tuple(
        replace(each, prim_path=template.name + each.prim_path.removeprefix(prim_path)) if each.prim_path else each
        for each in template.description.materials
    )
    return replace(template, description=replace(template.description, materials=materials))


def root_prim(stage: Usd.Stage) -> Usd.Prim | None:
    """Return the prim that a file is about: its default prim, else its only imageable root prim."""
    if stage.GetDefaultPrim():
        return stage.GetDefaultPrim()
    roots = [child for child in stage.GetPseudoRoot().GetChildren() if child.IsA(UsdGeom.Imageable)]
    return roots[0] if len(roots) == 1 else None


def stage_templates(stage: Usd.Stage, report: StageReport, taxonomy: str | None) -> tuple[Template, ...]:
    """Read the children of the class prim /Templates of a stage as templates.

    Args:
        stage: the stage.
        report: receives problems and omissions.
        taxonomy: taxonomy of the labels; None: "class", else "category", else any.
    """
    folder = stage.GetPrimAtPath(TEMPLATES_PRIM)
    if not folder or not folder.IsAbstract():
        return ()
    children = folder.GetFilteredChildren(ALSO_ABSTRACT)
    found = (
        template_of(child, display_name(child) or spaced(child.GetName()), report, taxonomy=taxonomy)
        for child in children
    )
    return tuple(each for each in found if each.description.instances)


def template_of(
    prim: Usd.Prim, name: str, report: StageReport, up_axis: str | None = None, taxonomy: str | None = None
) -> Template:
    """Read a prim and its descendants as a template.

    Args:
        prim: the prim.
        name: name of the template.
        report: receives a problem if the prim has no geometry, and all others.
        up_axis: "Y" or "Z", turn the template so that this axis is up; None: keep its axes.
        taxonomy: taxonomy of the labels; None: "class", else "category", else any.
    """
    stage = prim.GetStage()
    time = reading_time(stage, None)
    reader = StageReader(stage, time, report, taxonomy)
    world = Gf.Matrix4d(1.0)
    if prim.IsA(UsdGeom.Xformable):
        translation = UsdGeom.Xformable(prim).GetLocalTransformation(time).ExtractTranslation()
        world.SetTranslate(-translation)
    if up_axis is not None and up_axis != reader.up_axis:
        turn = Gf.Rotation(Gf.Vec3d(1, 0, 0), -90.0 if up_axis == "Y" else 90.0)
        world = world * Gf.Matrix4d(1.0).SetRotate(turn)
        reader.up_axis = "Y" if up_axis == "Y" else "Z"
    label = name_label(prim) if reader.by_name else inherited_label(prim, time, taxonomy)
    reader.walk(prim, TraversalContext(world), ALSO_ABSTRACT)
    description = reader.description(name)
    if not description.instances:
        report.problem(prim.GetPath(), "template", NOTHING_DRAWN)
    return as_template(description, prim, label, asset_name(prim) or name)


def as_template(description: SceneDescription, prim: Usd.Prim, label: str, asset: str) -> Template:
    """Return a description as the template of a prim, with its name.

    Args:
        description: what was read of the prim.
        prim: the prim.
        label: the category; "" for that of the first labeled part.
        asset: name of the asset, "" for none.
    """
    category = label or next((each.category for each in description.objects if each.category), "")
    whole = as_one(description, prim.GetName(), str(prim.GetPath()), category, asset)
    return Template(description.name, category, whole)


def display_name(prim: Usd.Prim) -> str:
    """Return the displayName metadata of a prim, "" if it has none."""
    return str(prim.GetDisplayName() or "")
