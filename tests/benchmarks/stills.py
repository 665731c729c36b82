# SPDX-License-Identifier: Apache-2.0
"""Stills of the shipped rooms compared with Mitsuba 3's `path` (LLVM): time to equal error, denoised by the same OIDN.

`room_01`, `room_02` and `room_03` as they are, seen by their first cameras. Each renderer denoises with its own
albedo and normal of the first hit, whose cost is included (Mitsuba's `aov` integrator). "matte": both are compared
with one converged picture, tiscene's. "glossy": materials are Mitsuba's `principled`, which differs from
UsdPreviewSurface, so each is compared with its own. relMSE: squared error over squared reference plus 0.01, mean over
pixels and seeds, minus the reference's own noise as estimated from its two halves. "fraction": tiscene's time over
Mitsuba's for the same error, by a power law between or beyond the measured samples; by wall time, and in brackets by
CPU time.
"""

from __future__ import annotations

from collections.abc import Sequence

from tests.benchmarks import shipped_rooms
from tests.benchmarks.reference_pictures import LARGE, SMALL, Plan, Row, cpu_for, measured, note, reference, times_for
from tiscene.scene.description import SceneDescription

DEPTH = 6


def main(large: bool = False, scenes: Sequence[str] = shipped_rooms.ROOMS) -> None:
    """Print the tables of scenes, at 256x192 or, if large, at 640x480."""
    for matte in (False, True):
        for scene in scenes:
            table(scene, shipped_rooms.still_room(scene, matte=matte).description, matte, LARGE if large else SMALL)


def table(scene: str, room: SceneDescription, matte: bool, plan: Plan) -> None:
    """Print one line for each renderer and number of samples."""
    size = plan.width, plan.height
    name = f"{scene} {'matte' if matte else 'glossy'} {plan.width}x{plan.height}"
    print(f"{name}, depth {DEPTH}, {plan.seeds} seeds, references of {2 * plan.half} spp")
    heads = ("wall ms", "CPU ms", "relMSE", "fraction")
    print(f"{'':>8} {'spp':>4}" + " {:>8} {:>8} {:>8} {:>12}".format(*heads) * 2 + "  (right: with OIDN)", flush=True)
    renderers = {"tiscene": shipped_rooms.tiscene(room, *size, DEPTH)}
    mitsuba = shipped_rooms.mitsuba(room, *size, DEPTH, glossy=not matte)
    if mitsuba is not None:
        renderers = {"Mitsuba": mitsuba} | renderers
    note(f"{name}: reference")
    shared = reference(renderers["tiscene"], plan.half)
    peer: list[Row] = []
    for renderer, render in renderers.items():
        note(f"{name}: {renderer}")
        own = renderer == "Mitsuba" and not matte
        truth = reference(render, plan.half) if own else shared
        rows = []
        for spp in plan.samples:
            rows.append(measured(render, spp, plan.seeds, truth))
            line(renderer, spp, rows[-1], peer)
        peer = rows
    means = (f"{renderer} {render(plan.samples[-1], 0)[0].mean():.4f}" for renderer, render in renderers.items())
    print(f"means of the pictures: {', '.join(means)}", flush=True)


def line(renderer: str, spp: int, row: Row, peer: list[Row]) -> None:
    """Print a row. peer: rows of the renderer to compare with; may be empty."""
    raw = denoised = ""
    if peer:
        wall, cpu = times_for(row, peer), cpu_for(row, peer)
        raw = f"{row.wall / wall[0]:.2f} ({row.cpu / cpu[0]:.2f})"
        denoised = f"{row.denoised_wall / wall[1]:.2f} ({row.denoised_cpu / cpu[1]:.2f})"
    print(
        f"{renderer:>8} {spp:4} {1e3 * row.wall:8.0f} {1e3 * row.cpu:8.0f} {row.error:8.4f} {raw:>12}"
        f" {1e3 * row.denoised_wall:8.0f} {1e3 * row.denoised_cpu:8.0f} {row.denoised_error:8.4f} {denoised:>12}",
        flush=True,
    )


if __name__ == "__main__":
    main()
