# SPDX-License-Identifier: Apache-2.0
"""Row "memory": long runs of frames, edits and restarts; memory, file descriptors and threads stay flat."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any

import tiscene as ts
from tests.stress.child_process import ROOT, ChildFailed, call
from tests.stress.outcomes import Outcome, count
from tests.stress.process_resources import resources

SIZE = {"width": 32, "height": 24}
SCENES = ("object_view", "solid_benchmark", "room_02")
SMALL_SCENES = ("object_view", "solid_benchmark", str(ROOT / "tests/usd/stages/materials.usda"))
LABELS = ("semantic", "instance", "depth", "forward_flow")
GROWTH = 0.05  # allowed growth of memory after the warm-up
RESTART_GROWTH = 0.10
WARM_UP = 0.1  # fraction of the steps


def scenario() -> ts.Scenario:
    """Return a scenario with three movers in the object view."""
    path = [ts.Waypoint((-0.4, 0.0, 0.0)), ts.Waypoint((0.4, 0.2, 0.0), (0, 90, 0)), ts.Waypoint((0.0, -0.2, 0.3))]
    objects = [
        ts.Object("cube", "Cube", dynamic=ts.LinearWaypoints(path, total_time=1.0), scale=0.5),
        ts.Object("dish", "Dish 01", dynamic=ts.CatmullWaypoints(path, total_time=2.0)),
        ts.Object("ball", "Sphere", (0.5, 0.0, -0.5), dynamic=ts.UniformMovementRandomBounce(0.5, seed=1)),
    ]
    return ts.Scenario("object_view", objects, timings=ts.AllTogether(0.0))


def _label_frames() -> Callable[[int], Any]:
    stream = ts.Stream(scenario(), buffers=LABELS, **SIZE)
    return lambda step: next(stream)


def _fast_frames() -> Callable[[int], Any]:
    stream = ts.Stream(scenario(), buffers=("rgb", *LABELS), quality="fast", base_spp=4, **SIZE)
    return lambda step: next(stream)


def _edits() -> Callable[[int], Any]:
    stream = ts.Stream("object_view", buffers=("instance",), **SIZE)

    def cycle(step: int) -> None:
        spawned = stream.world.spawn("Cube", (0.0, 0.1, 0.4), dynamic=ts.UniformMovementRandomBounce(0.5, seed=step))
        next(stream)
        stream.world.despawn(spawned)
        next(stream)

    return cycle


def _phases() -> Callable[[int], Any]:
    template = ("Cube", "Dish 01", "Sphere", "Ball 01")
    stream = ts.Stream("object_view", buffers=("instance", "depth"), **SIZE)

    def restart(step: int) -> None:
        mover = ts.UniformMovementRandomBounce(0.5, seed=step)
        names = (template[step % 4], template[step // 4 % 4])
        objects = [ts.Object(f"object_{i}", name, (0.3 * i, 0.1, 0.2), dynamic=mover) for i, name in enumerate(names)]
        stream.restart(ts.Scenario("object_view", objects))
        next(stream)

    return restart


def _scenes(scenes: tuple[str, ...] = SCENES) -> Callable[[int], Any]:
    scenarios = [ts.Scenario(scene, [ts.Object("ball", "Ball 01", (0, 1, 0))]) for scene in scenes]
    stream = ts.Stream(scenarios[0], buffers=("instance", "depth"), **SIZE)
    order = itertools.cycle(scenarios)

    def restart(step: int) -> None:
        stream.restart(next(order))
        next(stream)

    return restart


RUNS: dict[str, Callable[[], Callable[[int], Any]]] = {
    "labels": _label_frames,
    "fast": _fast_frames,
    "edits": _edits,
    "phases": _phases,
    "scenes": _scenes,
    "small scenes": lambda: _scenes(SMALL_SCENES),
}
# Name, full count, and allowed growth. A period is a number of steps after which the same scene is shown again.
PERIOD = 2 * len(SCENES)
USES: dict[str, tuple[str, int, float]] = {
    "labels": ("label frames", 100_000, GROWTH),
    "fast": ("`fast` frames", 10_000, GROWTH),
    "edits": ("cycles of spawn and despawn", 10_000, GROWTH),
    "phases": ("restarts of phases with other objects", 10_000, GROWTH),
    "scenes": (f"restarts over {len(SCENES)} scenes", 1_000, RESTART_GROWTH),
}


def measure(kind: str, steps: int, warm_up: int) -> dict[str, Any]:
    """Run in a child process: take steps and return resources after the warm-up, halfway and at the end.

    Args:
        kind: A key of RUNS.
        steps: Number of steps.
        warm_up: Number of steps before the first measurement.

    Returns:
        Lists "resident" (bytes), "files" and "threads", and "seconds" per step of the first and the last tenth.
    """
    step = RUNS[kind]()
    found: dict[str, Any] = {"resident": [], "files": [], "threads": [], "seconds": []}
    tenth = max(steps // 10, 1)
    began = 0.0
    for number in range(steps):
        if number in (warm_up, steps - tenth):
            began = time.perf_counter()
        step(number)
        if number in (warm_up + tenth - 1, steps - 1):
            found["seconds"].append((time.perf_counter() - began) / tenth)
        if number + 1 in (warm_up, (warm_up + steps) // 2, steps):
            held = resources()
            found["resident"].append(held.resident)
            found["files"].append(held.files)
            found["threads"].append(held.threads)
    return found


def run_one(use: str, kind: str, steps: int, warm_up: int, growth: float, seconds: float = 36000.0) -> Outcome:
    """Run one kind of steps in a process of its own and compare its end with its warm-up."""
    use = f"{steps:,} {use}"
    try:
        found = call("tests.stress.steady_state:measure", kind, steps, warm_up, seconds=seconds)
    except ChildFailed as error:
        return Outcome(use, str(error), False)
    (first, *_, last), files, threads = found["resident"], found["files"], found["threads"]
    grown = last / first - 1.0
    early, late = found["seconds"]
    figures = (
        f"{first >> 20} MB after {warm_up:,}, {last >> 20} MB at the end ({grown:+.1%}); files {files[0]} to "
        f"{files[-1]}, threads {threads[0]} to {threads[-1]}; {1e3 * early:.1f} ms a step early, {1e3 * late:.1f} late"
    )
    return Outcome(use, figures, grown < growth and files[-1] <= files[0] and threads[-1] <= threads[0])


def rows(scale: float, use: str | None = None) -> Iterator[Outcome]:
    """Run the row, or one of USES; scale 1 is the full count."""
    for kind in USES if use is None else (use,):
        name, full, growth = USES[kind]
        steps = count(full, scale, 100)
        warm_up = max(50, round(WARM_UP * steps))
        if kind == "scenes":
            steps = -(-count(full, scale, 30) // PERIOD) * PERIOD
            warm_up = 2 * PERIOD
        yield run_one(name, kind, steps, warm_up, growth)
