# SPDX-License-Identifier: Apache-2.0
"""Generate a data set: draw scenarios from a recipe and render each into a folder of its own."""

from __future__ import annotations

import contextlib
import shutil
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from dynamics.argument_checks import integer
from tiscene.errors import (
    ArgumentError,
    ExportError,
    MissingFile,
    ScenarioError,
    StageError,
    StageWarning,
    UnknownName,
    counted,
    export_errors,
)
from tiscene.export.array_files import json_file
from tiscene.export.exporter import export, provenance, writing_into
from tiscene.export.generation.data_set_index import DataSet
from tiscene.export.generation.recipe import Recipe
from tiscene.export.generation.scenario_summary import FILE, ScenarioSummary, read_summary
from tiscene.export.manifest import NAME as MANIFEST
from tiscene.export.manifest import Manifest
from tiscene.export.manifest_difference import Difference, differences, listing
from tiscene.export.shards import Shard
from tiscene.files import LOCK_NAME, write_atomically
from tiscene.frame.frame import Frame
from tiscene.render.view import image_size
from tiscene.scenario.scenario import Scenario
from tiscene.scenario.serialization import dumps
from tiscene.stream.stream import Stream

SCENARIO = "scenario.json"
OF_SCENARIO = ScenarioError, StageError, UnknownName, MissingFile  # errors that other scenarios may not have


def generate(
    recipe: Recipe,
    folder: str | Path,
    count: int,
    *,
    shard: tuple[int, int] = (0, 1),
    arch: str | None = None,
    progress: Callable[[int, int | None], None] | None = None,
    index_progress: Callable[[str, float], None] | None = None,
) -> DataSet:
    """Render the scenarios of a recipe, in one process and in constant memory.

    Scenarios that are done are not rendered again, so that the same call continues after an interruption, and a larger
    `count` extends the data set; a smaller one is refused if the index would lose scenarios. A scenario that cannot be
    drawn or read, such as one of a scene, camera or template that is not there, is noted in the index; the others go
    on.

    Args:
        recipe: What the scenarios are drawn from.
        folder: The folder to write: `<split>/000012/` for scenario 12, with its frames, `scenario.json`, `tiscene.json`
            and `summary.json`; and `index.jsonl`, `statistics.json`, `contact_sheet.png` and `dataset.json`.
        count: Number of scenarios.
        shard: (i, n): render part i of n; several processes may write into one folder at the same time. The index is
            then written by `finish`.
        arch: "cpu" or "cuda"; None: as of `Stream`.
        progress: Called with the number of a scenario and the index of its frame; None when the scenario is done.
        index_progress: Called with a task and the fraction of it that is done, while the index is written.

    Returns:
        The data set.

    Raises:
        ArgumentError: An argument or a setting of the recipe is invalid.
        ExportError: The folder has a data set of another recipe, more scenarios, scenarios of other files of a scene or
            template, or other files where scenarios go, or cannot be written.
    """
    integer(count, "count", 1)
    part = Shard(*shard, (0, count, 1))
    data_set = DataSet(Path(folder), recipe, count)
    claim(data_set)
    with ScenarioRenderer(data_set, arch) as renderer:
        for number in part.own_frames:
            renderer.render(number, progress)
            if progress is not None:
                progress(number, None)
    if part.count == 1:
        data_set.write_index(index_progress)
    return data_set


def finish(
    folder: str | Path, *, partial: bool = False, progress: Callable[[str, float], None] | None = None
) -> DataSet:
    """Write the index of a data set whose scenarios were made in shards.

    Args:
        folder: The folder of the data set.
        partial: Whether scenarios may be missing.
        progress: Called with a task and the fraction of it that is done.

    Raises:
        ExportError: The folder has no data set, or scenarios are missing and `partial` is not given.
    """
    data_set = DataSet.load(Path(folder))
    if data_set is None:
        raise ExportError(f"{str(folder)!r} has no data set: it has no dataset.json")
    missing = data_set.missing()
    if missing and not partial:
        raise ExportError(
            f"{counted(len(missing), 'scenario is', 'scenarios are')} missing of {data_set.count}, the first is "
            f"{missing[0]}: generate the shards that have them again, or index what is there with --partial"
        )
    data_set.write_index(progress)
    return data_set


def write_scenario(recipe: Recipe, folder: str | Path, number: int) -> Path:
    """Write a scenario of a recipe as a file, `<split>/000012.json`, without rendering anything.

    Returns:
        The file.

    Raises:
        ScenarioError, StageError, UnknownName, MissingFile: The scenario cannot be drawn; others of the recipe may.
        ExportError: The folder has another scenario of this number, or the file cannot be written.
    """
    path = Path(folder) / recipe.split(number) / f"{number:06d}.json"
    scenario = recipe.scenario(number)
    with export_errors(path):
        for present in sorted(Path(folder).glob(f"*/{path.name}")):
            if present != path or present.read_bytes() != dumps(scenario.to_json()).encode():
                raise ExportError(
                    f"{str(present)!r} is there and is not scenario {number} of this recipe. Choose another folder."
                )
        path.parent.mkdir(parents=True, exist_ok=True)
        scenario.save(path)
    return path


def claim(data_set: DataSet) -> None:
    """Write `dataset.json`, unless it is there. That of a recipe that failed before its first scenario is replaced.

    Raises:
        ExportError: The folder has scenarios of another recipe, more scenarios than the data set, or folders of others
            where scenarios go, or cannot be written.
    """
    present = DataSet.load(data_set.folder)
    if present is not None and not present.has_begun():
        present = None
    if present is not None:
        found = differences(present.recipe.to_json(), data_set.recipe.to_json())
    else:
        found = _differences_of_first_scenario(data_set)
    if found:
        raise ExportError(
            f"{str(data_set.folder)!r} has a data set of another recipe:{listing(found)}\nChoose another folder."
        )
    if present is None:
        for folder in data_set.present():  # which would be emptied
            names = {path.name for path in folder.iterdir()} - {LOCK_NAME}
            if names and not names & {FILE, MANIFEST}:
                raise ExportError(
                    f"{str(folder)!r} is there and is not of a data set: choose another folder, or move it away"
                )
    shrinks = present is None or present.count > data_set.count
    beyond = [each for each in data_set.present() if int(each.name) >= data_set.count] if shrinks else []
    if beyond:
        count = int(beyond[-1].name) + 1
        raise ExportError(
            f"{str(data_set.folder)!r} has {counted(len(beyond), 'scenario')} beyond the first {data_set.count}, such "
            f"as {str(beyond[-1])!r}, which the index would lack: pass count={count} (-n {count}) or more, or choose "
            "another folder"
        )
    if present is None or present.count != data_set.count:
        with export_errors(data_set.folder):
            data_set.save()


def _differences_of_first_scenario(data_set: DataSet) -> list[Difference]:
    """Return how the first scenario that is in the folder differs from the recipe's, where `dataset.json` is lost."""
    first = next((number for number in range(data_set.count) if data_set.has(number)), None)
    manifest = None if first is None else Manifest.load(data_set.scenario_folder(first))
    if first is None or manifest is None:
        return []
    recipe = data_set.recipe
    with Stream(recipe.scenario(first), **recipe.stream_settings()) as stream:
        wanted = provenance(stream, recipe.format, recipe.objects)
    names = "format", "buffers", "objects", "settings", "scenario"  # another version of tiscene may continue
    found = {name: manifest.provenance[name] for name in names}
    return differences(found, {name: wanted[name] for name in names})


class ScenarioRenderer:
    """Renders scenarios of a data set one after another, with one stream, which keeps the scenes that it has read.

    Args:
        data_set: The data set.
        arch: "cpu" or "cuda"; None: as of `Stream`.
    """

    def __init__(self, data_set: DataSet, arch: str | None) -> None:
        self.data_set, self._arch = data_set, arch
        self._stream: Stream | None = None
        self._files: dict[str, dict[str, str]] = {}  # their digests by scene or template
        self._categories: dict[int, list[str]] = {}

    def __enter__(self) -> ScenarioRenderer:
        return self

    def __exit__(self, *_: object) -> None:
        if self._stream is not None:
            self._stream.close()

    def render(self, number: int, progress: Callable[[int, int | None], None] | None = None) -> None:
        """Render a scenario, unless it is done. One that cannot be drawn or read gets a summary with its `error`.

        One with an `error` is tried again.

        Args:
            number: Of the scenario.
            progress: Called with the number of the scenario and the index of each frame.

        Raises:
            ArgumentError: A setting of the recipe is invalid.
            ExportError: The folder cannot be written, or has scenarios of other files of the scene or of a template.
        """
        summary = read_summary(self.data_set.scenario_folder(number))
        if summary is None or "error" in summary:  # what was not there may be now
            with export_errors(self.data_set.folder):
                self._render(number, progress)

    def _render(self, number: int, progress: Callable[[int, int | None], None] | None) -> None:
        recipe, folder = self.data_set.recipe, self.data_set.scenario_folder(number)
        about: dict[str, Any] = {"number": number, "split": recipe.split(number)}
        try:
            scenario = recipe.scenario(number)
            stream = self._restarted(scenario)
        except OF_SCENARIO as error:
            _clear(folder)
            write_atomically(folder / FILE, json_file({**about, "error": str(error)}))
            return
        if not self._files:
            for manifest in _recorded(self.data_set):
                made = manifest.provenance
                self._compare(made["scenario"]["scene"], made["file_digests"], manifest.categories)
        self._compare(scenario.scene, stream.file_digests(), stream.categories)
        _clear(folder)
        summary = ScenarioSummary(recipe.frames)

        def add(index: int, frame: Frame | None) -> None:
            if frame is None:  # the statistics would lack it
                raise ExportError(f"another process has written into {str(folder)!r}. Wait until it is done.")
            summary.add(frame)
            if progress is not None:
                progress(number, index)

        frames = range(recipe.frames)
        name = folder.name  # of all splits no two scenarios have the same number
        manifest = export(
            stream, folder, format=recipe.format, frames=frames, objects=recipe.objects, name=name, progress=add
        )
        scenario.save(folder / SCENARIO)
        cameras = [camera if isinstance(camera, str) else None for camera in scenario.cameras]
        about |= {"scene": scenario.scene, "cameras": cameras, "variants": dict(scenario.variants)}
        about["objects"] = [each.template for each in scenario.objects]
        summary.save(folder, about, manifest)

    def _compare(self, scene: str, digests: Mapping[str, str], categories: Mapping[int, str]) -> None:
        """Compare a scenario with those before it: each scene or template has the same files, each category one id.

        Warns of an id of several categories.

        Raises:
            ExportError: A scene or template has other files.
        """
        for source, files in _by_source(scene, digests).items():
            found = differences(self._files.setdefault(source, files), files)
            if found:
                raise ExportError(
                    f"{source!r} has changed since scenarios in {str(self.data_set.folder)!r} were made of it:"
                    f"{listing(found)}\nRestore it, or choose another folder."
                )
        for id, name in categories.items():
            names = self._categories.setdefault(id, [name])
            if name not in names:
                names.append(name)
                advice = f'name all categories in the recipe\'s settings, "categories": ["{names[0]}", "{name}", ...]'
                text = f"the category {id} is {names[0]!r} in some scenarios and {name!r} in others: {advice}"
                warnings.warn(StageWarning(text), stacklevel=2)

    def _restarted(self, scenario: Scenario) -> Stream:
        """Return the stream, restarted with a scenario. It depends on the scenario alone, not on those before it."""
        settings = self.data_set.recipe.stream_settings()
        if self._stream is None:
            try:
                self._stream = Stream(scenario, **{**settings, "arch": self._arch})
            except TypeError as error:
                raise ArgumentError(f"recipe: settings: {error}") from error
        else:
            resolution = self._stream.stages.stage(scenario).resolution
            width, height = image_size(settings.get("width"), settings.get("height"), resolution)
            self._stream.restart(scenario, width=width, height=height)
        return self._stream


def _recorded(data_set: DataSet) -> Iterator[Manifest]:
    """Yield manifests of some scenarios that are done, which together have all of their scenes and templates."""
    seen: set[str] = set()
    for number, summary in data_set.summaries():
        sources = set() if summary is None or "error" in summary else {summary["scene"], *summary["objects"]}
        if not sources <= seen:
            seen |= sources
            with contextlib.suppress(ExportError):  # a damaged manifest, which `verify` names
                manifest = Manifest.load(data_set.scenario_folder(number))
                if manifest is not None:
                    yield manifest


def _by_source(scene: str, digests: Mapping[str, str]) -> dict[str, dict[str, str]]:
    """Return the digests of files by scene or template, from those of `Stream.file_digests`."""
    result: dict[str, dict[str, str]] = {}
    for name, digest in digests.items():
        template, _, file = name.rpartition(": ")
        result.setdefault(template or scene, {})[file] = digest
    return result


def _clear(folder: Path) -> None:
    """Empty the folder of a scenario, which an interrupted run may have left: its summary is of all frames.

    Raises:
        ExportError: Another process writes into it.
    """
    with writing_into(folder):
        for path in folder.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path.name != LOCK_NAME:
                path.unlink()
