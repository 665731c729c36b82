# SPDX-License-Identifier: Apache-2.0
"""Stills of `room_02` against Mitsuba 3's `path` (LLVM): the time for the same error, both denoised by the same OIDN.

Each renderer denoises by its own albedo and normal of the first hit, whose cost is in its time (Mitsuba's `aov`
integrator). "matte": both are measured against one converged picture, tiscene's; "glossy": materials are Mitsuba's
`principled`, which is not quite UsdPreviewSurface, so that each is measured against its own. relMSE: squared error over
squared reference plus 0.01, mean over pixels and seeds; the reference's own noise, which its two halves tell, is taken
off. "part": tiscene's time as a part of Mitsuba's for the same error, by the power law between or beyond the samples
measured; by wall time, and in brackets by CPU time.
"""

from __future__ import annotations

from tests.benchmarks import living_room
from tests.benchmarks.reference_pictures import LARGE, SMALL, Plan, Row, cpu_for, measured, note, reference, times_for
from tiscene.scene.description import SceneDescription

DEPTH = 6


def main(large: bool = False) -> None:
    """Print the tables. large: 640x480 in the place of 256x192."""
    for matte in (True, False):
        table(living_room.room(0, matte=matte).description, matte, LARGE if large else SMALL)


def table(room: SceneDescription, matte: bool, plan: Plan) -> None:
    """One line for each renderer and number of samples."""
    size = plan.width, plan.height
    name = f"{'matte' if matte else 'glossy'} {plan.width}x{plan.height}"
    print(f"{name}, depth {DEPTH}, {plan.seeds} seeds, references of {2 * plan.half} spp")
    heads = ("wall ms", "CPU ms", "relMSE", "part")
    print(f"{'':>8} {'spp':>4}" + " {:>8} {:>8} {:>8} {:>12}".format(*heads) * 2 + "  (right: with OIDN)", flush=True)
    renderers = {"tiscene": living_room.tiscene(room, *size, DEPTH)}
    mitsuba = living_room.mitsuba(room, *size, DEPTH, glossy=not matte)
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
    """Print a row. peer: those that it is compared with, if there are any."""
    raw = clean = ""
    if peer:
        wall, cpu = times_for(row, peer), cpu_for(row, peer)
        raw = f"{row.wall / wall[0]:.2f} ({row.cpu / cpu[0]:.2f})"
        clean = f"{row.clean_wall / wall[1]:.2f} ({row.clean_cpu / cpu[1]:.2f})"
    print(
        f"{renderer:>8} {spp:4} {1e3 * row.wall:8.0f} {1e3 * row.cpu:8.0f} {row.error:8.4f} {raw:>12}"
        f" {1e3 * row.clean_wall:8.0f} {1e3 * row.clean_cpu:8.0f} {row.clean_error:8.4f} {clean:>12}",
        flush=True,
    )


if __name__ == "__main__":
    main()
