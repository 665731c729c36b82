# SPDX-License-Identifier: Apache-2.0
"""Exports and data sets made on a Ray cluster, with the bytes of one process."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynamics.argument_checks import integer
from tiscene.errors import ArgumentError, DeviceError, export_errors
from tiscene.export.distributed.frame_work import FrameWork
from tiscene.export.distributed.ray_pool import RayPool, connected
from tiscene.export.distributed.scenario_work import ScenarioWork
from tiscene.export.distributed.task_loop import run_tasks
from tiscene.export.distributed.task_plan import TaskPlan
from tiscene.export.exporter import open_manifest
from tiscene.export.folder_writer import FolderWriter
from tiscene.export.formats import find_format
from tiscene.export.generation.data_set_index import DataSet, with_frames
from tiscene.export.generation.generator import claim
from tiscene.export.generation.recipe import Recipe
from tiscene.export.manifest import Manifest
from tiscene.export.merging import merge
from tiscene.export.shards import SHARDS
from tiscene.files import lock_folder

if TYPE_CHECKING:
    from tiscene.scenario.scenario import Scenario

RUN_FILE = ".tiscene-run-"  # its name begins so; workers stop when it is gone


def render(
    source: str | Path | Scenario,
    folder: str | Path,
    *,
    frames: range,
    format: str = "png",
    objects: str | None = None,
    overwrite: bool = False,
    address: str | None = None,
    cpus: int | None = None,
    unlike: bool = False,
    progress: Callable[[int], None] | None = None,
    **settings: Any,
) -> Manifest:
    """Export frames of a stream on a Ray cluster: the files and the manifest are those of one process.

    A worker runs on each node, or beside each GPU with `arch="cuda"`. Each renders runs of consecutive frames as shards
    in `folder/shards`, which are merged at the end. The folder must be one that all nodes share. Frames of workers or
    nodes that are lost are rendered by others. The same call continues after an interruption.

    Args:
        source: As of `Stream`. Files must be at the same path on all nodes.
        folder: The folder to write.
        frames: Frame indices.
        format: As of `tiscene.export.export`.
        objects: As of `tiscene.export.export`.
        overwrite: As of `tiscene.export.export`.
        address: "host:port" of the cluster; "local" for this machine alone; None for that in RAY_ADDRESS, else the
            one that runs on this machine, else "local". A process that is connected to Ray stays so.
        cpus: Processors of each worker; None: all of its node, or its share beside each GPU.
        unlike: Whether nodes may have other processors or versions of libraries; color may then differ in the last
            bits.
        progress: Called now and then with the number of frames that are there.
        **settings: Further arguments of `Stream`.

    Returns:
        The manifest, which is saved as `tiscene.json`.

    Raises:
        MissingExtra: Ray is not installed.
        ArgumentError: An argument is invalid.
        ExportError: The folder holds other frames, is being written by another process, or cannot be written.
        DeviceError: There is no such cluster, or a worker failed; the message has its error.
        KeyboardInterrupt: The workers have been stopped. The shards stay.
    """
    if cpus is not None:
        integer(cpus, "cpus", 1)
    folder = Path(folder).absolute()
    if not len(frames):
        raise ArgumentError(f"frames={frames!r}: has no frames")
    packs = hasattr(find_format(format).writer(), "pack")
    work = FrameWork(source, settings, folder, frames, format=format, objects=objects, overwrite=overwrite)
    plan = TaskPlan(range(work.count))
    result: list[Manifest] = []

    def skip_present(provenance: dict[str, Any]) -> None:
        """Refuse a folder with other frames; leave out tasks whose frames an earlier run has merged."""
        manifest = open_manifest(folder, provenance, overwrite)
        result.append(manifest)
        if not manifest.frames:
            return
        writer = FolderWriter(folder, manifest)
        present = [task for task in range(work.count) if all(map(writer.holds, work.shard(task).own_frames))]
        if not packs or len(present) == work.count:  # a file of many frames is packed from all of its frames
            plan.skip(present)

    _run(folder, work, plan, address, cpus, settings.get("arch"), unlike, skip_present, progress)
    parts = [part for task in range(work.count) if (part := work.shard(task).folder(folder)).is_dir()]
    if parts:
        result.append(merge(folder, parts, partial=True, unlike=unlike))
        shutil.rmtree(folder / SHARDS)
    return result[-1]


def generate(
    recipe: Recipe,
    folder: str | Path,
    count: int,
    *,
    arch: str | None = None,
    address: str | None = None,
    cpus: int | None = None,
    unlike: bool = False,
    progress: Callable[[int], None] | None = None,
    index_progress: Callable[[str, float], None] | None = None,
) -> DataSet:
    """Render the scenarios of a recipe on a Ray cluster: the files are those of one process.

    Args:
        recipe: What the scenarios are drawn from.
        folder: The folder to write, which all nodes must share.
        count: Number of scenarios.
        arch: "cpu" or "cuda"; None: as of `Stream`.
        address: As of `render`.
        cpus: As of `render`.
        unlike: As of `render`.
        progress: Called now and then with the number of scenarios that are there.
        index_progress: As of `tiscene.export.generation.generator.generate`.

    Returns:
        The data set.

    Raises:
        TisceneError: As `render` does.
        KeyboardInterrupt: The workers have been stopped. Scenarios that are done stay.
    """
    integer(count, "count", 1)
    if cpus is not None:
        integer(cpus, "cpus", 1)
    data_set = DataSet(Path(folder).absolute(), recipe, count)
    claim(data_set)
    work = ScenarioWork(data_set, arch)
    done = set(with_frames(data_set.summaries()))
    plan = TaskPlan(range(work.count))
    plan.skip([task for task in range(work.count) if done.issuperset(work.numbers(task))])
    if not plan.finished:
        _run(data_set.folder, work, plan, address, cpus, arch, unlike, None, progress)
    data_set.write_index(index_progress)
    return data_set


def _run(
    folder: Path,
    work: FrameWork | ScenarioWork,
    plan: TaskPlan,
    address: str | None,
    cpus: int | None,
    arch: str | None,
    unlike: bool,
    opened: Callable[[dict[str, Any]], None] | None,
    progress: Callable[[int], None] | None,
) -> None:
    """Run the tasks of a plan on the cluster."""
    finished = _StepCount(work, plan)

    def report() -> None:
        if progress is not None:
            progress(finished())

    with export_errors(folder):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with connected(address), lock_folder(folder):
                file = folder / f"{RUN_FILE}{secrets.token_hex(6)}"
                # The file is gone before the pool waits for its workers, which then end.
                with RayPool(work, file, arch=arch, cpus=cpus) as pool, _present(file):
                    run_tasks(pool, plan, unlike=unlike, opened=opened, progress=report)
        except ConnectionError as error:
            raise DeviceError(f"the connection to the Ray cluster was lost: {error}") from error


class _StepCount:
    """Counts frames or scenarios that are there: those of tasks that are done, and of tasks that workers have."""

    def __init__(self, work: FrameWork | ScenarioWork, plan: TaskPlan) -> None:
        self._work, self._plan = work, plan
        self._tasks = self._steps = 0  # tasks that are counted, and their steps

    def __call__(self) -> int:
        self._steps += sum(map(self._work.size, self._plan.done[self._tasks :]))
        self._tasks = len(self._plan.done)
        return self._steps + sum(map(self._work.steps, self._plan.held))


@contextlib.contextmanager
def _present(file: Path) -> Iterator[None]:
    """Keep a file for the time of a run; those of killed runs are deleted."""
    for old in file.parent.glob(f"{RUN_FILE}*"):
        old.unlink(missing_ok=True)
    file.write_text(f"process {os.getpid()}: workers stop when this file is gone\n")
    try:
        yield
    finally:
        file.unlink(missing_ok=True)
