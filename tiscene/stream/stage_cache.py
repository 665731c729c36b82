# SPDX-License-Identifier: Apache-2.0
"""StageCache: the stages that a stream has read last, so that restarting into one of them reads and builds nothing."""

from __future__ import annotations

import os
import warnings
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from dynamics.argument_checks import flag
from tiscene import catalog
from tiscene.errors import ArgumentTypeError, StageWarning
from tiscene.frame.buffers import rendered_buffers
from tiscene.render.render_settings import RenderSettings
from tiscene.scenario.scenario import Scenario
from tiscene.scene.description import SceneDescription, Template
from tiscene.stream.bvh_cache import BVHCache
from tiscene.stream.loading import load
from tiscene.usd.core.layers import catalog_path, layer_digests, layer_state, scene_digests
from tiscene.usd.core.limits import Limits
from tiscene.usd.read.kept_templates import kept_template
from tiscene.usd.read.subprocess_reader import read_in_subprocess
from tiscene.usd.read.template import read_template

MAX_STAGES = 3


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

    Raises:
        ArgumentTypeError: an argument is of the wrong type.
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
        strict: bool,
        subdivision: int | None,
        limits: Limits | None,
    ) -> None:
        if not isinstance(limits, Limits | None):
            raise ArgumentTypeError(f"limits={limits!r}: must be ts.Limits(seconds=..., memory=...)")
        self.arch = arch
        self._loading: dict[str, Any] = {
            "buffers": rendered_buffers(buffers),
            "settings": settings,
            "untrusted": flag(untrusted, "untrusted"),
            "limits": limits,
        }
        self._options: dict[str, Any] = {"taxonomy": taxonomy, "time_code": time_code, "root": root}
        self._options |= {"strict": flag(strict, "strict"), "subdivision": subdivision}
        self._stages: dict[tuple[Any, ...], SceneDescription] = {}
        self.trees = BVHCache()

    @property
    def subdivision(self) -> int | None:
        """Triangles that subdivision surfaces are refined to at most; None: the default."""
        return cast(int | None, self._options["subdivision"])

    def stage(self, scenario: Scenario) -> SceneDescription:
        """Return the stage of a scenario, with its variants selected and the prims that it moves extracted.

        It is read again once one of its layers or textures has changed; with `untrusted` or `limits`, once its own file
        has.

        Raises:
            SceneNotFound, MissingFile, StageError: the stage cannot be found or read.
        """
        file = catalog.find_scene(scenario.scene)
        key = self._key(scenario)
        stage = self._stages.pop(key, None)
        if stage is None:
            options = self._options | {"variants": dict(scenario.variants) or None, "extract": scenario.moved_prims}
            stage, self.arch = load(file, arch=self.arch, **self._loading, **options)
        self._stages[key] = stage
        while len(self._stages) > MAX_STAGES:
            self.trees.drop(self._stages.pop(next(iter(self._stages))))
        return stage

    def without_empty_objects(self, scenario: Scenario) -> Scenario:
        """Return a stage's own scenario without the moving prims that are left out, since they are broken or empty.

        Their joints are left out too, with a StageWarning.
        """
        stage = self.stage(scenario)
        empty = {each.name for each in stage.templates if not each.description.instances}
        kept = tuple(each for each in scenario.objects if each.template not in empty)
        if len(kept) < len(scenario.objects):
            gone = {each.id for each in scenario.objects if each.template in empty}
            joints = tuple(each for each in scenario.joints if gone.isdisjoint((each.body, each.parent)))
            if len(joints) < len(scenario.joints):
                joined = {id for each in scenario.joints for id in (each.body, each.parent)}
                names = ", ".join(sorted(gone & joined))
                text = f"{scenario.scene}: joints are left out, of objects that have no shape: {names}"
                warnings.warn(StageWarning(text), stacklevel=3)
            pairs = [each for each in scenario.filtered_pairs if gone.isdisjoint(each)]
            scenario = replace(scenario, objects=kept, joints=joints, filtered_pairs=pairs)
            self._stages[self._key(scenario)] = stage
        return scenario

    def _key(self, scenario: Scenario) -> tuple[Any, ...]:
        """Return what the stage of a scenario depends on."""
        file = catalog.find_scene(scenario.scene)
        variants = tuple(sorted(scenario.variants.items()))
        return str(file.resolve()), variants, scenario.moved_prims, self._state(file)

    def _state(self, file: Path) -> Hashable:
        """Return what changes with the files of a stage; with its own file alone if none may be opened here."""
        isolated = self._loading["untrusted"] or self._loading["limits"] is not None
        return file.stat().st_mtime_ns if isolated else layer_state(file)

    def template(self, name: str, scenario: Scenario, stage: SceneDescription) -> Template:
        """Read an object template by name or file.

        Raises:
            TemplateNotFound, StageError: it cannot be found or read.
        """
        path = next((each.prim_path for each in stage.objects if each.name == name), "")
        hint = f"The object {name!r} of the stage is the template {path!r}." if path else ""
        file = catalog.find_template(name, scene=scenario.scene, hint=hint)
        options = {
            "up_axis": stage.up_axis,
            "taxonomy": self._options["taxonomy"],
            "variants": catalog.template_variants(name)[1],
        }
        limits, root = self._bounds(file)
        if limits is None and root is None:
            return kept_template(file, **options)
        return read_template(file, **options, limits=limits, root=root)

    def file_digests(self, scene: str, templates: Iterable[str]) -> dict[str, str]:
        """Return `scene_digests`. Files that may not be opened here are opened in a process with limits."""
        return scene_digests(scene, templates, self._digests_of)

    def _digests_of(self, file: Path) -> dict[str, str]:
        limits, _ = self._bounds(file)
        return layer_digests(file) if limits is None else read_in_subprocess(layer_digests, file, {}, limits)

    def _bounds(self, file: Path) -> tuple[Limits | None, Path | None]:
        """Return the limits and the root folder for reading a file. Those of the catalog are of no unknown origin."""
        limits, root = self._loading["limits"], self._options["root"]
        if catalog_path(file.resolve()) is not None:
            return limits, None
        if self._loading["untrusted"]:
            limits, root = limits or Limits(), root or file.resolve().parent
        return limits, None if root is None else Path(root)
