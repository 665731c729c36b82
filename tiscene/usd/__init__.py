"""USD files to scene descriptions: the only folder of tiscene that imports pxr."""

from __future__ import annotations

from pathlib import Path

from tiscene.scene.description import SceneDescription
from tiscene.usd.problems import Report
from tiscene.usd.reader import StageReader, root_context
from tiscene.usd.stage import Variants, open_stage, quiet, readable, reading_time
from tiscene.usd.template import read_template, stage_templates

__all__ = ["read_stage", "read_template"]


def read_stage(
    path: str | Path, *, time_code: float | None = None, variants: Variants | None = None
) -> SceneDescription:
    """Read a USD stage (.usd, .usda, .usdc, .usdz) as it is at one time code.

    time_code: None for the start of the stage's range, else the earliest value of everything.
    variants: what to select where, `{"/Room{lighting}": "night"}`; no file is changed.

    The world keeps the stage's own axes (`up_axis` says which one is up); lengths become metres. A thing with an
    identity is the nearest enclosing prim of kind `component`, else a native instance, else the gprim itself; each
    point of a PointInstancer is one thing.

    Raises MissingFile, StageError (with every problem found) and UnknownName or ArgumentError (variants). What is
    left out or approximated is named in one StageWarning.
    """
    with quiet(), readable(path):
        stage = open_stage(path, variants)
        report = Report(str(path))
        reader = StageReader(stage, reading_time(stage, time_code), report)
        reader.walk(stage.GetPseudoRoot(), root_context(stage))
        templates = stage_templates(stage, report)
        report.raise_problems()
    report.warn()
    file = Path(path)
    name = file.resolve().parent.name if file.stem == "scene" else file.stem
    return reader.description(name, templates)
