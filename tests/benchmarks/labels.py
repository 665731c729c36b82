# SPDX-License-Identifier: Apache-2.0
"""Time per frame of the label pass, wall and CPU.

First the label pass alone: the benchmark room under a moving camera, for sets of buffers and for each buffer in
addition to `instance`. Placing the instances and building the TLAS is a separate row. Then whole frames of `room_02`
from a stream with a fixed camera and three movers: the buffers alone, with boxes and visible pixels of all objects, and
with every column of the object table.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import taichi as ti

import tiscene as ts
from tests.benchmarks.movers import bouncing_movers
from tests.benchmarks.room import room, static_placement
from tests.benchmarks.timing import timed
from tiscene.frame.buffers import LABELS, times_needed
from tiscene.frame.object_table import ObjectState
from tiscene.render.annotations.object_measurements import Measurer
from tiscene.render.integrators.labels.label_pass import LabelPass
from tiscene.render.view import View
from tiscene.scene.device_scene import DeviceScene

SIZES = ((256, 192), (640, 480))
BUFFER_SETS = {
    "instance": ("instance",),
    "default": ("semantic", "instance", "depth", "forward_flow"),
    "no occlusion": tuple(name for name in LABELS if not name.endswith("occlusion")),
    "all but coverages": tuple(name for name in LABELS if not name.endswith("coverage")),
    "all": LABELS,
}
ROUNDS = 15


def milliseconds(work: Callable[[], object]) -> tuple[float, float]:
    """Return the shortest wall and CPU time of ROUNDS runs after a warm-up run, ms."""

    def finished() -> None:
        work()
        ti.sync()

    work()
    walls, cpus, _ = zip(*(timed(finished) for _ in range(ROUNDS)), strict=True)
    return 1e3 * min(walls), 1e3 * min(cpus)


def main() -> None:
    """Print both tables."""
    description = room()
    placement = static_placement(description)
    scene = DeviceScene()
    scene.add(description)
    labels = LabelPass(scene)
    camera = description.cameras[0]
    moved = camera.with_pose(tuple(np.add(camera.position, (0.02, 0.0, 0.01))), camera.rotation)
    print(f"{'':>10} {'buffers':>20} {'wall ms':>9} {'CPU ms':>9}")
    for width, height in SIZES:
        for name, buffers in BUFFER_SETS.items():
            times = times_needed(buffers)
            scene.place(placement, times)
            view = View(camera, camera, moved, width, height)

            def render(view: View = view, buffers: tuple[str, ...] = buffers) -> object:
                return labels.render(view, buffers)

            wall, cpu = milliseconds(render)
            print(f"{f'{width}x{height}':>10} {name:>20} {wall:>9.1f} {cpu:>9.1f}")
    for count, times in ((1, (1,)), (3, (0, 1, 2))):
        wall, cpu = milliseconds(lambda times=times: scene.place(replace(placement), times))  # type: ignore[misc]
        print(f"{'place':>10} {f'{count} times':>20} {wall:>9.1f} {cpu:>9.1f}")
    view = View(camera, camera, moved, *SIZES[0])
    scene.place(placement, (0, 1, 2))
    alone = milliseconds(lambda: labels.render(view, ("instance",)))[1]
    for name in LABELS:
        cpu = milliseconds(lambda name=name: labels.render(view, ("instance", name)))[1]  # type: ignore[misc]
        print(f"{name:>20}: {max(cpu - alone, 0.0):.1f} ms of CPU time in addition to instance ({alone:.1f})")
    zero = (0.0, 0.0, 0.0)
    bare = ObjectState(0, "", "", "", 0, "", zero, (1.0, 0.0, 0.0, 0.0), zero, 0, None, box=(zero, zero))
    states = [replace(bare, id=id) for id in np.unique(placement.instance_id).tolist()]
    wall, _, _ = timed(lambda: Measurer(scene).table(placement, view, states).columns())
    print(f"every column of {len(states)} objects, at first access: {1e3 * wall:.0f} ms")
    frames()


def frames() -> None:
    """Print the time of whole frames of a stream."""
    scenario = ts.Scenario("room_02", bouncing_movers())
    accesses: dict[str, Callable[[ts.Frame], object]] = {
        "frame": lambda frame: frame,
        "boxes, visible pixels": lambda frame: [(row.visible_box, row.visible_pixels) for row in frame.objects],
        "every column": lambda frame: frame.objects.columns(),
    }
    for name in ("default", "all but coverages", "all"):
        stream = ts.Stream(scenario, buffers=BUFFER_SETS[name])
        for label, access in accesses.items():
            stream.seek(0)
            wall, cpu = milliseconds(lambda stream=stream, access=access: access(next(stream)))  # type: ignore[misc]
            print(f"{'room_02':>10} {name:>20} {label:>24} {wall:>9.1f} {cpu:>9.1f}")


if __name__ == "__main__":
    main()
