# SPDX-License-Identifier: Apache-2.0
"""Time per frame of each export format, relative to rendering the same frames alone, wall and CPU.

Frames of `room_02` with three movers and a fixed camera: label buffers, and what a format requires beside them. Formats
that require `rgb` get one sample per pixel. A format whose extra is not installed is omitted.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import tiscene as ts
from tests.benchmarks.movers import bouncing_movers
from tests.benchmarks.timing import timed
from tiscene.errors import MissingExtra
from tiscene.export import FORMATS, export

BUFFERS = ("semantic", "instance", "depth", "forward_flow", "forward_occlusion")
FRAMES = 96
ROUNDS = 2


def main(formats: tuple[str, ...] = tuple(FORMATS), frames: int = FRAMES, rounds: int = ROUNDS) -> None:
    """Print the table.

    Args:
        formats: names of formats.
        frames: number of frames of each export.
        rounds: how often each is measured; the shortest times count.
    """
    print(f"{'format':>12} {'alone':>15} {'export':>15} {'ratio':>13} {'kB a frame':>11}")
    print(f"{'':>12} {'wall':>7} {'CPU':>7} {'wall':>7} {'CPU':>7} {'wall':>6} {'CPU':>6}   (ms a frame)")
    streams: dict[tuple[str, ...], ts.Stream] = {}
    for name in formats:
        buffers = BUFFERS if FORMATS[name].optional is None else FORMATS[name].buffers
        if buffers not in streams:
            streams = {buffers: _stream(buffers)}
        stream = streams[buffers]
        try:
            print(_row(stream, name, frames, rounds), flush=True)
        except MissingExtra as error:
            print(f"{name:>12} is omitted: {error}")


def _row(stream: ts.Stream, format: str, frames: int, rounds: int) -> str:
    """Return the row of a format."""
    sizes: list[int] = []

    def render() -> None:
        for index in range(frames):
            stream[index]

    def write() -> None:
        with tempfile.TemporaryDirectory() as folder:
            export(stream, folder, format=format, frames=range(frames))
            sizes.append(sum(path.stat().st_size for path in Path(folder).rglob("*") if path.is_file()))

    render()
    with tempfile.TemporaryDirectory() as folder:  # imports the libraries of the format
        export(stream, folder, format=format, frames=range(2))
    pairs = [(timed(render)[:2], timed(write)[:2]) for _ in range(rounds)]
    alone, exported = (
        [1e3 * min(times) / frames for times in zip(*each, strict=True)] for each in zip(*pairs, strict=True)
    )
    ratios = [e / a for e, a in zip(exported, alone, strict=True)]
    return (
        f"{format:>12} {alone[0]:>7.1f} {alone[1]:>7.1f} {exported[0]:>7.1f} {exported[1]:>7.1f} "
        f"{ratios[0]:>6.2f} {ratios[1]:>6.2f} {1e-3 * sizes[-1] / frames:>11.0f}"
    )


def _stream(buffers: tuple[str, ...]) -> ts.Stream:
    scenario = ts.Scenario("room_02", bouncing_movers())
    return ts.Stream(scenario, buffers=buffers, quality="preview", spp=1, incremental=False)


if __name__ == "__main__":
    main()
