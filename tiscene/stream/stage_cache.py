# SPDX-License-Identifier: Apache-2.0
"""StageCache: the stages that a stream has read last, so that restarting into one of them reads and builds nothing."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, cast

from dynamics.argument_checks import integer
from tiscene import catalog
from tiscene.frame.buffers import rendered_buffers
from tiscene.render.render_settings import RenderSettings
from tiscene.render.view import check_image_size
from tiscene.scenario.scenario import Scenario
from tiscene.scene.description import SceneDescription, Template
from tiscene.stream.loading import load
from tiscene.stream.warm_trees import WarmTrees
from tiscene.usd.core.layers import scene_digests
from tiscene.usd.core.limits import Limits
from tiscene.usd.read.kept_templates import kept_template
from tiscene.usd.read.template import read_template

MAX_STAGES = 3

MAX_SIZE = 16384  # px


class StageCache:
    """Reads the stages and templates of scenarios, in one way.

    Attributes:
        trees: trees of the stages that are kept.

    Args:
        buffers: of the frames to come; they decide which kernels are compiled while the first stage is read.
        settings: of the frames to come.
        arch: "cpu", "cuda" or None for the default.
        untrusted: read stages in a process with limits.
        taxonomy: of the semantic labels.
        time_code: show stages as they are then, without motion; None: they play.
        root: folder that all files must be in.
        strict: refuse stages with a broken part.
        subdivision: triangles that subdivision surfaces are refined to at most; None: the default.
        limits: bounds of time and memory of reading; None: the defaults for untrusted stages, else none.
    """

    def __init__(
        self,
        buffers: Sequence[str],
        settings: RenderSettings,
        *,
        arch: str | None,
        untrusted: bool,
        taxonomy: str | None,
        time_code: float | None,
        root: str | os.PathLike[str] | None,
        strict: bool = False,
        subdivision: int | None = None,
        limits: Limits | None = None,
    ) -> None:
        self.arch = arch
        self._loading: dict[str, Any] = {
            "buffers": rendered_buffers(buffers),
            "settings": settings,
            "untrusted": untrusted,
            "limits": limits,
        }
        self._options: dict[str, Any] = {"taxonomy": taxonomy, "time_code": time_code, "root": root}
        self._options |= {"strict": strict, "subdivision": subdivision}
        self._stages: dict[tuple[Any, ...], SceneDescription] = {}
        self.trees = WarmTrees()

    @property
    def subdivision(self) -> int | None:
        """Triangles that subdivision surfaces are refined to at most; None: the default."""
        return cast(int | None, self._options["subdivision"])

    def stage(self, scenario: Scenario) -> SceneDescription:
        """Return the stage of a scenario, with its variants selected and the prims that it moves extracted.

        Raises:
            SceneNotFound, MissingFile, StageError: the stage cannot be found or read.
        """
        file = catalog.find_scene(scenario.scene)
        key = self._key(scenario)
        stage = self._stages.pop(key, None)
        if stage is None:
            options = self._options | {"variants": dict(scenario.variants) or None, "extract": _extracted(scenario)}
            stage, self.arch = load(file, arch=self.arch, **self._loading, **options)
        self._stages[key] = stage
        while len(self._stages) > MAX_STAGES:
            self.trees.drop(self._stages.pop(next(iter(self._stages))))
        return stage

    def without_empty_objects(self, scenario: Scenario) -> Scenario:
        """Return a stage's own scenario without the moving prims that are left out, since they are broken or empty."""
        stage = self.stage(scenario)
        empty = {each.name for each in stage.templates if not each.description.instances}
        kept = tuple(each for each in scenario.objects if each.template not in empty)
        if len(kept) < len(scenario.objects):
            scenario = replace(scenario, objects=kept)
            self._stages[self._key(scenario)] = stage
        return scenario

    @staticmethod
    def _key(scenario: Scenario) -> tuple[Any, ...]:
        """Return what the stage of a scenario depends on."""
        file = catalog.find_scene(scenario.scene)
        variants = tuple(sorted(scenario.variants.items()))
        return str(file.resolve()), variants, _extracted(scenario), file.stat().st_mtime_ns

    def template(self, name: str, scenario: Scenario, stage: SceneDescription) -> Template:
        """Read an object template by name or file.

        Raises:
            TemplateNotFound, StageError: it cannot be found or read.
        """
        file, variants = catalog.find_template(name, scene=scenario.scene), catalog.template_variants(name)[1]
        taxonomy, limits = self._options["taxonomy"], self._loading["limits"]
        if limits is not None:
            return read_template(file, up_axis=stage.up_axis, taxonomy=taxonomy, variants=variants, limits=limits)
        return kept_template(file, up_axis=stage.up_axis, taxonomy=taxonomy, variants=variants)


def _extracted(scenario: Scenario) -> tuple[str, ...]:
    """Return the paths of the prims that a scenario moves."""
    return tuple(sorted({each.template for each in scenario.objects if catalog.is_prim_path(each.template)}))


def file_digests(scenario: Scenario, stage: SceneDescription) -> dict[str, str]:
    """Return the SHA-256 of every file that a scenario's stage and templates consist of.

    Returns:
        Digests by path relative to the scene's folder; a template's paths begin with its name and a colon.
    """
    on_stage = {template.name for template in stage.templates}
    return scene_digests(scenario.scene, {history.spec.template for history in scenario.lives()} - on_stage)


def digest(digests: dict[str, str]) -> str:
    """Return one SHA-256 over the digests of files."""
    text = "\n".join(f"{name} {digests[name]}" for name in sorted(digests))
    return hashlib.sha256(text.encode()).hexdigest()


def image_size(width: int | None, height: int | None, resolution: tuple[int, int] | None = None) -> tuple[int, int]:
    """Return the size of the images: what the caller gave, completed from the stage's resolution, else 256 x 192.

    Raises:
        ArgumentError: The size is no number of pixels, or too large to be rendered.
    """
    if resolution is not None and width is None:
        width = resolution[0] if height is None else max(1, round(height * resolution[0] / resolution[1]))
    if resolution is not None and height is None and width is not None:
        height = max(1, round(width * resolution[1] / resolution[0]))
    width, height = 256 if width is None else width, 192 if height is None else height
    size = integer(width, "width", 1, MAX_SIZE), integer(height, "height", 1, MAX_SIZE)
    check_image_size(*size)
    return size
