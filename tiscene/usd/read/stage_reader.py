# SPDX-License-Identifier: Apache-2.0
"""read_stage: a USD file as a SceneDescription, in this process or in a child process with limits."""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from tiscene.errors import ArgumentError
from tiscene.scene.description import SceneDescription
from tiscene.usd.core.limits import Limits, ReadingBudget, RootFolder
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import check_taxonomy, scene_name
from tiscene.usd.core.stage import Variants, changes_over_time, open_stage, quiet, readable, reading_time
from tiscene.usd.geometry.draw_modes import apply_draw_modes
from tiscene.usd.geometry.skinning import prepare_skinning
from tiscene.usd.geometry.subdivision_budget import DEFAULT_TRIANGLES, limit_subdivision
from tiscene.usd.lights.light_linking import prepare_links
from tiscene.usd.read.extracted_prims import RemainderReader, extracted_templates
from tiscene.usd.read.gravity import read_gravity
from tiscene.usd.read.room_volumes import read_room_volumes
from tiscene.usd.read.subprocess_reader import read_in_subprocess
from tiscene.usd.read.template import stage_templates
from tiscene.usd.read.traversal_context import TraversalContext

_MAX_DISTANCE = 5000.0  # m: of a stage from the world's origin; there rays start 5 cm off the surfaces that they leave


def read_stage(
    path: str | Path,
    *,
    time_code: float | None = None,
    variants: Variants | None = None,
    extract: Collection[str] = (),
    taxonomy: str | None = None,
    root: str | os.PathLike[str] | None = None,
    untrusted: bool = False,
    limits: Limits | None = None,
    isolate: bool | None = None,
    strict: bool = False,
    subdivision: int | None = None,
) -> SceneDescription:
    """Read a USD stage (.usd, .usda, .usdc, .usdz) at one time code.

    The description keeps the stage's axes (`up_axis`); lengths are converted to meters. An object is the nearest
    enclosing prim of kind `component`, else a native instance, else the gprim itself; each point of a PointInstancer is
    an object.

    Args:
        path: the file.
        time_code: time code to read; None: the start of the stage's range, else each attribute's earliest value.
        variants: variant selections, `{"/Room{lighting}": "night"}`; no file is changed.
        extract: paths of prims that a scenario moves. Each is left out of the scene and becomes a template, named by
            its path.
        taxonomy: taxonomy of the semantic labels; None: "class", else "category", else any. On a stage without labels
            the categories are derived from the names of the objects.
        root: folder that every layer and texture must be in, after resolving links; None: no restriction.
        untrusted: read a file that may be damaged or malicious: isolated, with `Limits()` unless `limits` is given, and
            with the file's own folder as `root` unless one is given.
        limits: upper bounds on prims, triangles, time and memory; None: `Limits()` for prims and triangles, no
            bound on memory, and a bound on time that is checked between prims only.
        isolate: whether to read in a child process, which is stopped when `limits.seconds` or `limits.memory` is
            exceeded, and whose crash is a StageError. None: if `limits` is given or the file is untrusted.
        strict: whether to refuse a stage with a broken part: a missing file, or a prim that contradicts itself. False:
            the part is left out, and the stage is refused only if nothing else is drawn.
        subdivision: triangles that all subdivision surfaces together are refined to at most, with smaller triangles for
            surfaces near the stage's cameras; 0: none is refined. None: 3,000,000.

    Raises:
        MissingFile: there is no such file.
        StageError: the stage cannot be rendered (lists every problem found), or a limit is exceeded.
        UnknownName: a variant, taxonomy or prim to extract that the stage does not have.
        ArgumentError: an argument outside its range.

    Content that is left out or approximated is listed in one StageWarning.
    """
    if untrusted:
        if isolate is False:
            raise ArgumentError("isolate=False: an untrusted file is always read in a process of its own")
        root = Path(path).resolve().parent if root is None else root
    if isolate or untrusted or (isolate is None and limits is not None):
        limits = limits or Limits()
        options: dict[str, Any] = {
            "time_code": time_code,
            "variants": variants,
            "extract": tuple(extract),
            "taxonomy": taxonomy,
            "strict": strict,
            "subdivision": subdivision,
            "root": None if root is None else Path(root),
            "limits": limits,
            "isolate": False,
        }
        return read_in_subprocess(read_stage, path, options, limits)
    root_folder = RootFolder(root)
    with quiet(), readable(path):
        budget = ReadingBudget(str(path), limits or Limits())
        report = StageReport(str(path), root=root_folder, budget=budget, strict=strict)
        stage = open_stage(path, variants, report)
        root_folder.check(stage, str(path))
        report.reads_animation = time_code is None and changes_over_time(stage)
        check_taxonomy(stage, taxonomy)
        time = reading_time(stage, time_code)
        apply_draw_modes(stage, time, report)
        prepare_skinning(stage, time, report)
        prepare_links(stage, report)
        limit_subdivision(stage, time, DEFAULT_TRIANGLES if subdivision is None else subdivision, report)
        reader = RemainderReader(stage, time, report, extract, taxonomy)
        reader.walk(stage.GetPseudoRoot(), TraversalContext())
        own = stage_templates(stage, report, taxonomy)
        extracted = extracted_templates(stage, extract, time, report, taxonomy)
        templates = (*own, *(template for template, _ in extracted))
        description = reader.description(scene_name(Path(path)), templates)
        moved = tuple(box for template, box in extracted if template.description.instances)
        rooms, gravity = read_room_volumes(stage, time, report), read_gravity(stage, report)
        description = replace(description, rooms=rooms, gravity=gravity, moved=moved)
        root_folder.check(stage, str(path))
        report.raise_problems(anything_left=bool(description.instances or templates))
        _report_distance(description, stage, report)
    report.warn()
    return description


def _report_distance(description: SceneDescription, stage: Usd.Stage, report: StageReport) -> None:
    """Report a stage that as a whole lies so far from the world's origin that single precision shows."""
    if not description.instances:
        return
    # A mesh far from its own origin is read relative to its center, so that these are near the meshes.
    places = np.array([each.world_from_object[:3, 3] for each in description.instances])
    distance = float(np.abs(places).max(axis=1).min())
    if distance <= _MAX_DISTANCE:
        return
    back = 0.0 - np.round(np.median(places, axis=0)) / float(UsdGeom.GetStageMetersPerUnit(stage))
    text = (
        f"all of it lies {distance / 1000.0:.0f} km or more from the world's origin, where positions are rounded to "
        f"{1000.0 * np.spacing(np.float32(distance)):.0f} mm and light leaks below objects that stand on others; "
        f"translate its root prims by ({', '.join(f'{each:.0f}' for each in back.tolist())})"
    )
    report.omission("/", text)
