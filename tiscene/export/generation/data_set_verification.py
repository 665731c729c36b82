# SPDX-License-Identifier: Apache-2.0
"""Verify a data set: its scenarios, their files, some frames rendered again, and its index."""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tiscene.errors import ArgumentError, DeviceError, ExportError, TisceneError, counted
from tiscene.export.generation.data_set_index import DATA_SET, DataSet, index_files, with_frames
from tiscene.export.generation.generator import SCENARIO
from tiscene.export.generation.scenario_summary import frames_digest
from tiscene.export.manifest import Manifest
from tiscene.export.verification import evenly, verify
from tiscene.scenario.scenario import Scenario


@dataclass(frozen=True)
class DataSetVerification:
    """What verifying a data set has found.

    Attributes:
        scenarios: Number of scenarios that the data set should have.
        failed: Number of those that the index has with an `error`, and so without frames.
        frames: Number of frames of the others.
        rendered: Number of frames that were rendered again.
        problems: What is wrong, by scenario (its folder, "train/000012"; one that is not of the data set too) or file
            of the index.
    """

    scenarios: int
    failed: int
    frames: int
    rendered: int
    problems: dict[str, tuple[str, ...]]

    @property
    def is_good(self) -> bool:
        """Whether everything is as recorded."""
        return not self.problems


def verify_data_set(
    folder: str | Path,
    *,
    sample: int | None = None,
    search: Sequence[str | Path] = (),
    arch: str | None = None,
    progress: Callable[[int, int | None], None] | None = None,
    index_progress: Callable[[str, float], None] | None = None,
) -> DataSetVerification:
    """Compare the scenarios of a data set with their manifests and summaries, and its index with the summaries.

    What is wrong in a scenario does not keep the others from being verified.

    Args:
        folder: The folder of the data set.
        sample: How many frames are rendered again, evenly from the first scenario to the last; 0: none; None: all.
        search: As of `verify`.
        arch: "cpu" or "cuda"; None: as of `Stream`.
        progress: Called with the number of a scenario and the index of a frame that was rendered; None when the
            scenario is done.
        index_progress: Called with a task and the fraction of it that is done, while the index is compared.

    Raises:
        ArgumentError: `sample` or `arch` is invalid.
        ExportError: The folder has no data set, or its `dataset.json` is damaged.
    """
    if sample is not None and sample < 0:
        raise ArgumentError(f"sample={sample}: must be 0 or more")
    data_set = DataSet.load(Path(folder))
    if data_set is None:
        raise ExportError(f"{str(folder)!r} has no data set: it has no {DATA_SET}")
    length = data_set.recipe.frames
    summaries = list(data_set.summaries())
    made = with_frames(summaries)
    chosen: dict[int, list[int]] = {}
    for place in evenly(range(len(made) * length), sample):
        chosen.setdefault(made[place // length], []).append(place % length)
    problems: dict[str, tuple[str, ...]] = {}
    failed = frames = rendered = 0
    for number, summary in summaries:
        scenario = data_set.scenario_folder(number)
        found: list[str] = []
        if summary is None:
            found = ["is missing, or its summary.json is damaged; `tiscene generate` makes it"]
        elif "error" in summary:
            failed += 1
        else:
            shown = None if progress is None else functools.partial(_show_rendered, progress, number)
            found = list(_contradictions(scenario, summary, length))
            again = [] if found else chosen.get(number, [])
            try:
                verified = verify(scenario, frames=again, search=search, arch=arch, progress=shown)
            except (ArgumentError, DeviceError):
                raise
            except TisceneError as error:
                found.append(str(error))
            else:
                frames += verified.frames
                rendered += verified.rendered
                found += verified.problems()
        if found:
            problems[scenario.relative_to(data_set.folder).as_posix()] = tuple(dict.fromkeys(found))
        if progress is not None:
            progress(number, None)
    for path in data_set.others():
        name = path.relative_to(data_set.folder).as_posix()
        problems[name] = (f"is not of the data set, which has {counted(data_set.count, 'scenario')}",)
    index = ((data_set.folder / name, [content]) for name, content in index_files(summaries).items())
    with contextlib.suppress(ExportError):  # damage of a scenario, which is named above
        for path, content in itertools.chain(index, data_set.joined(made, index_progress)):
            if not _has_content(path, content):
                name = path.relative_to(data_set.folder).as_posix()
                problems[name] = (f"is not that of the scenarios; `tiscene merge {folder}` writes it again",)
    return DataSetVerification(data_set.count, failed, frames, rendered, problems)


def _show_rendered(progress: Callable[[int, int | None], None], number: int, index: int, is_rendered: bool) -> None:
    """Report a frame of a scenario, unless only its files were compared."""
    if is_rendered:
        progress(number, index)


def _has_content(path: Path, parts: Iterable[bytes] | None) -> bool:
    """Return whether a file has some content, and no more; None: whether it is not there."""
    if parts is None or not path.is_file():
        return parts is None and not path.exists()
    with path.open("rb") as file:
        return all(file.read(len(part)) == part for part in parts) and not file.read(1)


def _contradictions(folder: Path, summary: dict[str, Any], length: int) -> Iterator[str]:
    """Yield in what a scenario's manifest, scenario and summary contradict each other."""
    try:
        manifest = Manifest.load(folder)
        if manifest is None:
            return  # `verify` says so
        if list(manifest.frames) != list(range(length)):
            yield f"has {counted(len(manifest.frames), 'frame')} in place of {length}"
        if summary.get("digest") != frames_digest(manifest):
            yield "its summary.json is not that of its frames"
        if Scenario.load(folder / SCENARIO).to_json() != manifest.provenance["scenario"]:
            yield f"its {SCENARIO} is not that of its frames"
    except TisceneError as error:
        yield str(error)
