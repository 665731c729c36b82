# SPDX-License-Identifier: Apache-2.0
"""Read a USD stage into a SceneDescription."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path
from typing import cast

from tiscene.scene.description import SceneDescription
from tiscene.usd.core.limits import Limits, Root, Spent
from tiscene.usd.core.report import StageReport
from tiscene.usd.core.semantics import check_taxonomy
from tiscene.usd.core.stage import Variants, changes_over_time, open_stage, quiet, readable, reading_time
from tiscene.usd.geometry.skinning import bake_skinning
from tiscene.usd.read.extracted_prims import RemainderReader, lifted_templates
from tiscene.usd.read.subprocess_reader import SubprocessReader
from tiscene.usd.read.template import stage_templates
from tiscene.usd.read.traversal import Context


def read_stage(
    path: str | Path,
    *,
    time_code: float | None = None,
    variants: Variants | None = None,
    lifted: Collection[str] = (),
    taxonomy: str | None = None,
    root: str | os.PathLike[str] | None = None,
    untrusted: bool = False,
    limits: Limits | None = None,
) -> SceneDescription:
    """Read a USD stage (.usd, .usda, .usdc, .usdz) as it is at one time code.

    time_code: None for the start of the stage's range, else the earliest value of everything.
    variants: what to select where, `{"/Room{lighting}": "night"}`; no file is changed.
    taxonomy: of the semantic labels; None for "class", else "category", else any. On a stage without any label things
    have those that their names say.
    root: the folder that every layer and texture must be in, by real paths; None for anywhere.
    untrusted: read it in a process of its own, which can be stopped, with the file's own folder as root if none is
    given; for files that may be damaged or hostile.
    limits: what reading may take, see `Limits`.
    lifted: paths of prims that are to move: each is left out, and becomes a template whose name is its path.

    The world keeps the stage's own axes (`up_axis` says which one is up); lengths become meters. A thing with an
    identity is the nearest enclosing prim of kind `component`, else a native instance, else the gprim itself; each
    point of a PointInstancer is one thing.

    Raises MissingFile, StageError (with every problem found) and UnknownName or ArgumentError (variants, taxonomy,
    lifted). What is left out or approximated is named in one StageWarning.
    """
    limits = limits or Limits()
    if untrusted:
        root = Path(path).resolve().parent if root is None else root
        options = {"time_code": time_code, "variants": variants, "lifted": tuple(lifted)}
        with SubprocessReader(path, options | {"taxonomy": taxonomy, "root": Path(root)}, limits) as reading:
            return cast(SceneDescription, reading.result())
    inside = Root(root)
    with quiet(), readable(path):
        stage = open_stage(path, variants)
        inside.check(stage, str(path))
        report = StageReport(
            str(path), plays=time_code is None and changes_over_time(stage), root=inside, spent=Spent(str(path), limits)
        )
        check_taxonomy(stage, taxonomy)
        time = reading_time(stage, time_code)
        bake_skinning(stage, time, report)
        reader = RemainderReader(stage, time, report, lifted, taxonomy)
        reader.walk(stage.GetPseudoRoot(), Context())
        templates = (
            *stage_templates(stage, report, taxonomy),
            *lifted_templates(stage, lifted, time, report, taxonomy),
        )
        report.raise_problems()
    report.warn()
    file = Path(path)
    name = file.resolve().parent.name if file.stem == "scene" else file.stem
    return reader.description(name, templates)
