# SPDX-License-Identifier: Apache-2.0
"""Recipe: what the scenarios of a data set are drawn from, as a JSON file.

Scenario k depends on the recipe and k alone: not on the number of scenarios, nor on the process that renders it. So a
data set can be extended, and its parts can be made anywhere.
"""

from __future__ import annotations

import inspect
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynamics.argument_checks import integer, not_negative
from tiscene import catalog
from tiscene.errors import ArgumentError, MissingFile, ScenarioError, TisceneError, UnknownName, did_you_mean
from tiscene.export.formats import find_format
from tiscene.frame.buffers import buffer_names
from tiscene.render.view import image_size
from tiscene.scenario import serialization
from tiscene.scenario.providers import provider
from tiscene.scenario.relative_files import beside
from tiscene.scenario.scenario import DRAWN_FACTORS, Scenario
from tiscene.stream.stream import STREAM_ARGUMENTS
from tiscene.usd.core.layers import cached_by_layers
from tiscene.usd.read.stage_render_settings import stage_resolution

MAX_NAME = 255  # bytes, of file systems
DRAWS = 8  # seeds that are tried for one scenario
RANGES = tuple(  # arguments of `Scenario.sample` that a recipe may give
    name
    for name in inspect.signature(Scenario.sample).parameters
    if name not in ("scene", "seed", "camera", "frames", "variants")
)
SETTINGS = tuple(  # arguments of `Stream` that a recipe may give
    name for name in STREAM_ARGUMENTS if name not in ("frames", "arch", "limits", "progress")
)
FILES = {"scenes", "ranges"}  # fields that name files
OF_SCENARIOS = ("camera", "variants")  # arguments of `Stream` that change its scenario


@dataclass(frozen=True)
class SceneChoice:
    """A scene of a recipe.

    Attributes:
        scene: Its name or file.
        weight: How often it is drawn, relative to the others.
        variants: Names of variants to draw from, by prim and set: {"/Room{lighting}": ["day", "night"]}.
        cameras: Names of cameras to draw one from; () for the scene's own.
        ranges: Arguments of `Scenario.sample`, beside those of the recipe.
    """

    scene: str
    weight: float = 1.0
    variants: Mapping[str, Sequence[str]] = field(default_factory=dict)
    cameras: Sequence[str] = ()
    ranges: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Recipe:
    """What scenarios are drawn from, and how they are rendered.

    Attributes:
        scenes: Scenes: names, files, or objects with the fields of SceneChoice.
        ranges: Arguments of `Scenario.sample`: {"objects": [1, 3], "speed": [0.2, 0.8]}.
        frames: Number of frames of each scenario.
        settings: Arguments of `Stream`: {"width": 256, "buffers": ["rgb", "instance"], "quality": "fast"}. `camera` and
            `variants` are those of every scenario; `variants` of a scene are drawn in addition.
        format: Export format of each scenario.
        objects: Rows in the files of labels, as of `export`.
        splits: Shares of the splits, by name. A scenario is in one split with all of its frames.
        seed: 0 to 2^63 - 1.
    """

    scenes: Sequence[SceneChoice]
    ranges: Mapping[str, Any] = field(default_factory=dict)
    frames: int = 24
    settings: Mapping[str, Any] = field(default_factory=dict)
    format: str = "png"
    objects: str | None = None
    splits: Mapping[str, float] = field(default_factory=lambda: {"train": 1.0})
    seed: int = 0

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Recipe:
        """Read a recipe. Relative paths of scenes and templates are those of `Scenario.load`.

        Raises:
            MissingFile: There is no such file.
            ArgumentError, ScenarioError: It is not a recipe; the message names the file and the place in it.
        """
        folder = Path(path).parent

        def make(content: Any) -> Recipe:
            if isinstance(content, dict):
                content |= {name: _from_folder(content[name], folder) for name in FILES & content.keys()}
            return cls.from_json(content)

        return serialization.read(path, make)

    @classmethod
    def from_json(cls, content: Any) -> Recipe:
        """Make a recipe from JSON values. Raises ArgumentError, which names the place of the mistake."""
        values = dict(_checked(content, cls, "recipe"))
        if not isinstance(values.get("scenes"), list | tuple) or not values["scenes"]:
            raise ArgumentError(
                'recipe: "scenes" must be a list with at least one scene, such as '
                '["room_01", {"scene": "room_02", "weight": 2}]'
            )
        scenes = []
        for place, each in enumerate(values["scenes"]):
            if isinstance(each, str):
                scenes.append(SceneChoice(each))
            else:
                choice = _checked(each, SceneChoice, f"scenes[{place}]")
                if not isinstance(choice.get("scene"), str):
                    raise ArgumentError(f'scenes[{place}]: needs "scene", a name or a file')
                cameras = choice.get("cameras", ())
                scenes.append(SceneChoice(**{**choice, "cameras": tuple(cameras) if _are_names(cameras) else cameras}))
        values["scenes"] = tuple(scenes)
        recipe = cls(**values)
        recipe._check()
        return recipe

    def to_json(self) -> dict[str, Any]:
        """Return the recipe as JSON values."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        values["scenes"] = [
            {each.name: getattr(choice, each.name) for each in fields(choice)} for choice in self.scenes
        ]
        result: dict[str, Any] = json.loads(json.dumps(values))
        return result

    def split(self, number: int) -> str:
        """Return the split of a scenario."""
        names = list(self.splits)
        shares = np.array([self.splits[name] for name in names], np.float64)
        return names[int(self._random(number, "split").choice(len(names), p=shares / shares.sum()))]

    def scenario(self, number: int) -> Scenario:
        """Return a scenario.

        Raises:
            ScenarioError: Nothing fits the ranges, with any of several seeds.
        """
        random = self._random(number, "scene")
        weights = np.array([choice.weight for choice in self.scenes], np.float64)
        choice = self.scenes[int(random.choice(len(self.scenes), p=weights / weights.sum()))]
        drawn_camera = str(random.choice(list(choice.cameras))) if choice.cameras else None
        given = self.settings.get("camera") or drawn_camera
        camera, *others = given if isinstance(given, list) else [given]
        variants = {place: str(random.choice(list(names))) for place, names in sorted(choice.variants.items())}
        variants = {**self.settings.get("variants", {}), **variants}
        ranges = {**self.ranges, **choice.ranges}
        if "aspect" not in ranges:
            ranges["aspect"] = self._aspect(choice.scene, variants)
        mistakes = []
        for seed in random.integers(0, 2**63, DRAWS).tolist():
            try:
                fixed: dict[str, Any] = {"camera": camera, "variants": variants, "frames": self.frames}
                drawn = Scenario.sample(choice.scene, seed=seed, **fixed, **ranges)
                scenario = Scenario.from_json(drawn.to_json() | {"variants": {**drawn.variants, **variants}})
                cameras: list[Any] = [*scenario.cameras, *others]
                return replace(scenario, camera=cameras) if others else scenario
            except ScenarioError as error:
                mistakes.append(str(error))
        raise ScenarioError(f"scenario {number} in {choice.scene!r}: {mistakes[-1]} ({DRAWS} seeds were tried)")

    def unknown_names(self) -> list[str]:
        """Return messages about scenes and templates that are not there, in the order of the scenes.

        That is no mistake of the recipe: they may be there when, or where, a scenario is made.
        """
        found = []
        for choice in self.scenes:
            try:
                catalog.find_scene(choice.scene)
                for name in {**self.ranges, **choice.ranges}.get("templates") or ():
                    catalog.find_template(name)
            except (UnknownName, MissingFile) as error:
                found.append(str(error))
        return list(dict.fromkeys(found))

    def _aspect(self, scene: str, variants: Mapping[str, str]) -> float:
        """Return width / height of the images that the stream makes of a scene."""
        width, height = self.settings.get("width"), self.settings.get("height")
        resolution = None
        if width is None or height is None:
            resolution = _resolution(catalog.find_scene(scene), json.dumps(variants, sort_keys=True))
        width, height = image_size(width, height, resolution)
        return width / height

    def _random(self, number: int, what: str) -> np.random.Generator:
        return np.random.default_rng([self.seed, number, *what.encode()])

    def stream_settings(self) -> dict[str, Any]:
        """Return the settings that are not part of the scenarios."""
        buffers = find_format(self.format).default_buffers
        settings = {"buffers": buffers, **self.settings} if buffers is not None else self.settings
        return {name: value for name, value in settings.items() if name not in OF_SCENARIOS}

    def _check(self) -> None:
        """Raise ArgumentError for a value that is wrong."""
        form = find_format(self.format)
        for name in ("ranges", "settings", "splits"):
            _mapping(getattr(self, name), f"recipe: {name}")
        _check_names(self.settings, SETTINGS, "recipe: settings")
        _mapping(self.settings.get("variants", {}), "recipe: settings: variants")
        camera = self.settings.get("camera", "")
        if not isinstance(camera, str) and not _are_names(camera):
            raise ArgumentError(f"recipe: settings: camera={camera!r}: must be a name or a list of names")
        buffers = self.settings.get("buffers")
        if buffers is not None:
            try:
                form.check(buffer_names(buffers))
            except TisceneError as error:
                raise ArgumentError(f"recipe: settings: {error}") from error
        integer(self.frames, "recipe: frames", 1)
        integer(self.seed, "recipe: seed", 0, 2**63 - 1)
        _check_names(self.ranges, RANGES, "recipe: ranges")
        for place, choice in enumerate(self.scenes):
            _check_names(_mapping(choice.ranges, f"scenes[{place}]: ranges"), RANGES, f"scenes[{place}]: ranges")
            _check_choices(choice, f"scenes[{place}]")
            if camera and choice.cameras:
                raise ArgumentError(
                    f"scenes[{place}]: cameras: settings.camera={camera!r} is that of every scenario; leave one out"
                )
            ranges = {"frames": self.frames, **self.ranges, **choice.ranges}
            try:
                provider("ranges")(
                    **{name: ranges[name] for name in ranges if name not in (*DRAWN_FACTORS, "difficulty")}
                )
            except ArgumentError as error:
                raise ArgumentError(f"{f'scenes[{place}]' if choice.ranges else 'recipe'}: ranges: {error}") from error
        if not self.splits:
            raise ArgumentError('recipe: "splits" must be shares by name, such as {"train": 0.8, "val": 0.2}')
        for name, share in self.splits.items():
            if re.fullmatch(r"\w[\w .-]*", name) is None:
                raise ArgumentError(f"recipe: splits: {name!r} is no name of a folder: use letters, digits, - and _")
            if len(os.fsencode(name)) > MAX_NAME:
                raise ArgumentError(f"recipe: splits: {name!r} is longer than a name of a folder: {MAX_NAME} bytes")
            not_negative(share, f"recipe: splits: {name}")
        if sum(self.splits.values()) <= 0 or sum(choice.weight for choice in self.scenes) <= 0:
            raise ArgumentError('recipe: the shares of "splits" and the weights of "scenes" must have a sum above 0')


def _from_folder(content: Any, folder: Path) -> Any:
    """Return scenes and ranges of a recipe in a folder, as JSON values, with paths from the working directory."""
    if isinstance(content, Mapping):
        return {name: _from_folder(each, folder) for name, each in content.items()}
    if isinstance(content, list):
        return [_from_folder(each, folder) for each in content]
    return beside(content, folder) if isinstance(content, str) else content


@cached_by_layers(64)
def _resolution(file: Path, variants: str) -> tuple[int, int] | None:
    """Return the resolution that a stage asks for; `variants` as JSON."""
    return stage_resolution(file, json.loads(variants))


def _check_choices(choice: SceneChoice, place: str) -> None:
    """Raise ArgumentError for a wrong weight, camera or variant of a scene."""
    not_negative(choice.weight, f"{place}: weight")
    lists = {"cameras": choice.cameras, **_mapping(choice.variants, f"{place}: variants")}
    for name, names in lists.items():
        if not _are_names(names) or (name != "cameras" and not names):
            raise ArgumentError(f"{place}: {name}: must be a list of names to draw from, got {names!r}")


def _are_names(content: Any) -> bool:
    """Return whether JSON values are a list of names."""
    return isinstance(content, list | tuple) and all(isinstance(each, str) for each in content)


def _mapping(content: Any, place: str) -> Mapping[str, Any]:
    """Return JSON values that are a mapping."""
    if not isinstance(content, Mapping):
        raise ArgumentError(f"{place}: must be an object, got {content!r}")
    return content


def _checked(content: Any, kind: type, place: str) -> Mapping[str, Any]:
    """Return JSON values that are a mapping with the names of fields only."""
    return _check_names(_mapping(content, place), [each.name for each in fields(kind)], place)


def _check_names(content: Mapping[str, Any], known: Sequence[str], place: str) -> Mapping[str, Any]:
    """Return a mapping. Raises ArgumentError for a name that is not known."""
    for name in content:
        if name not in known:
            hint = did_you_mean(name, known) or f"; there are {', '.join(known)}"
            raise ArgumentError(f"{place}: no field {name!r}{hint}")
    return content
